import msgspec
import numpy as np
import pytest

from bunraku import builtin
from bunraku.formats import write_character
from bunraku.formats.gltf import encode_character, read_figure
from bunraku.formats.gltf.document import split_container
from bunraku.formats.gltf.draft import Draft
from bunraku.formats.gltf.humanoid import REQUIRED, add_vrm, rename_bones
from bunraku.humanoids import name_joints
from bunraku.types import Character, Skin
from tests.formats.made_gltf import made_arm

BONES = {name: 10 + i for i, name in enumerate((*REQUIRED, "leftThumbMetacarpal"))}
OLD = {1, 2}
ONE = {
    "extensionsUsed": ["VRMC_vrm", "VRMC_springBone"],
    "extensions": {
        "VRMC_vrm": {
            "meta": {"name": "kept"},
            "humanoid": {"humanBones": {"hips": {"node": 1}}},
        },
        "VRMC_springBone": {
            "springs": [
                {"name": "hair", "joints": [{"node": 2}]},
                {"name": "flag", "joints": [{"node": 5}]},
            ]
        },
    },
}
ZERO = {
    "extensionsUsed": ["VRM"],
    "extensions": {
        "VRM": {
            "meta": {"title": "kept"},
            "humanoid": {"humanBones": [{"bone": "hips", "node": 1}], "armStretch": 0.05},
            "firstPerson": {"firstPersonBone": 1},
            "secondaryAnimation": {"boneGroups": [{"bones": [2]}, {"bones": [5]}]},
        }
    },
}


def draft(json):
    return Draft(msgspec.json.decode(msgspec.json.encode(json)), bytearray())


def test_the_bones_of_a_vrm_1_become_the_new_joints():
    made = draft(ONE)
    assert rename_bones(made, BONES, old=OLD) == ["1 spring chains of the old rig are left out"]
    vrm, springs = (made.json["extensions"][name] for name in ("VRMC_vrm", "VRMC_springBone"))
    assert vrm["meta"] == {"name": "kept"}
    assert vrm["humanoid"]["humanBones"]["hips"] == {"node": 10}
    assert [spring["name"] for spring in springs["springs"]] == ["flag"]


def test_springs_that_all_moved_old_joints_go():
    made = draft(ONE)
    rename_bones(made, BONES, old={2, 5})
    assert made.json["extensionsUsed"] == ["VRMC_vrm"]
    assert "VRMC_springBone" not in made.json["extensions"]


def test_the_bones_of_a_vrm_0_become_the_new_joints_under_their_older_names():
    made = draft(ZERO)
    rename_bones(made, BONES, old=OLD)
    vrm = made.json["extensions"]["VRM"]
    found = {bone["bone"]: bone["node"] for bone in vrm["humanoid"]["humanBones"]}
    assert found["hips"] == 10
    assert found["leftThumbProximal"] == BONES["leftThumbMetacarpal"]
    assert vrm["humanoid"]["armStretch"] == 0.05
    assert vrm["firstPerson"]["firstPersonBone"] == BONES["head"]
    assert vrm["secondaryAnimation"]["boneGroups"] == [{"bones": [5]}]


@pytest.mark.parametrize("json", [ONE, ZERO])
def test_a_performance_that_is_no_human_makes_it_plain(json):
    made = draft(json)
    bones = {name: node for name, node in BONES.items() if name != "head"}
    (message,) = rename_bones(made, bones, old=OLD)
    assert message == "is no VRM any more: the performance has no head"
    assert "extensions" not in made.json
    assert "extensionsUsed" not in made.json


def test_a_plain_file_stays_plain_unless_asked():
    made = draft({"extensionsUsed": ["KHR_materials_unlit"]})
    assert rename_bones(made, BONES, old=OLD) == []
    assert made.json == {"extensionsUsed": ["KHR_materials_unlit"]}
    add_vrm(made, BONES, path="folder/hero.glb")
    assert made.json["extensionsUsed"] == ["KHR_materials_unlit", "VRMC_vrm"]
    assert made.json["extensions"]["VRMC_vrm"]["meta"]["name"] == "hero"


def bind(figure):
    """Hang a figure on the first joint of the built-in human."""
    human = builtin.human()
    weights = np.zeros((len(figure.mesh.vertices), len(human.skeleton.names)))
    weights[:, 0] = 1.0
    return Character(figure.mesh, human.skeleton, Skin(weights, human.skin.inverse_bind))


def test_a_vrm_is_written_with_the_nodes_of_the_joints(tmp_path):
    figure = read_figure("made.glb", made_arm().glb())
    character = bind(figure)
    content = encode_character(
        figure, character, bones=name_joints(character.skeleton), make_vrm=True
    )
    json = msgspec.json.decode(split_container("made.vrm", content)[0])
    bones = json["extensions"]["VRMC_vrm"]["humanoid"]["humanBones"]
    assert {json["nodes"][bone["node"]]["name"] for bone in bones.values()} == set(bones)
    write_character(tmp_path / "made.vrm", figure, character, bones=name_joints(character.skeleton))
    assert (tmp_path / "made.vrm").read_bytes() == content


def test_a_vrm_wants_a_whole_human():
    figure = read_figure("made.glb", made_arm().glb())
    bones = {"hips": 0, "spine": 1}
    with pytest.raises(ValueError, match="a VRM wants head, leftUpperLeg, leftUpperArm, "):
        encode_character(figure, bind(figure), bones=bones, make_vrm=True)

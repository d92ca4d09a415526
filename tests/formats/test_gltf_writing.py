import json
import struct

import numpy as np
import pytest

from bunraku.formats.gltf import encode_character, encode_mesh, read_character, read_figure
from bunraku.formats.gltf.document import read_document, split_container
from bunraku.formats.gltf.rigging import strongest_influences
from bunraku.rotations import compose_transforms, vectors_to_matrices
from bunraku.skinning import forward_kinematics, play_clip
from bunraku.types import Character, Clip, Figure, Mesh, Skeleton, Skin
from tests.formats.made_gltf import TRIANGLE, made_arm, made_triangle

PNG = b"\x89PNG\r\n\x1a\n" + bytes(40)


def opened(content):
    """Split a GLB into its JSON and its bytes."""
    text, binary = split_container("out.glb", content)
    return json.loads(text), bytes(binary)


def make_character(mesh, rng, roots=1):
    """Bind a mesh to two joints in turned frames, with a clip that turns, moves and scales."""
    rest = compose_transforms(rng.normal(size=(2, 3)), vectors_to_matrices(rng.normal(size=(2, 3))))
    parents = np.array([-1, 0 if roots == 1 else -1])
    skeleton = Skeleton(("root", "tip"), parents, rest)
    weights = rng.dirichlet(np.ones(2), size=len(mesh.vertices))
    skin = Skin(weights, np.linalg.inv(forward_kinematics(parents, rest)))
    turns = rng.normal(size=(5, 2, 4))
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    clip = Clip(
        "dance", np.linspace(0, 1, 5), rng.normal(size=(5, 2, 3)), turns, np.full((5, 2, 3), 1.5)
    )
    return Character(mesh, skeleton, skin, (clip,))


def made_rich():
    """A document with a bit of everything that has to survive."""
    made = made_triangle()
    made.json |= {
        "extras": {"author": "me", "none": None, "big": 2**60, "third": 1 / 3},
        "extensionsUsed": ["ACME_scene", "KHR_materials_unlit"],
        "extensions": {"ACME_scene": {"nodes": [0, 1], "x": 1.0}},
        "materials": [{"name": "red", "extensions": {"KHR_materials_unlit": {}}}],
        "images": [{"bufferView": made.view(PNG), "mimeType": "image/png", "name": "picture"}],
        "textures": [{"source": 0}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
    }
    first = made.json["meshes"][0]
    first |= {"name": "first", "weights": [0.5], "extras": {"targetNames": ["smile"]}}
    first["primitives"][0] |= {
        "material": 0,
        "targets": [{"POSITION": made.array(TRIANGLE / 2, "VEC3")}],
        "extensions": {"ACME_primitive": {"accessor": 0}},
    }
    first["primitives"][0]["attributes"] |= {
        "TEXCOORD_0": made.array(TRIANGLE[:, :2], "VEC2"),
        "COLOR_1": made.array(TRIANGLE, "VEC3"),
        "_TEMPERATURE": made.array([1, 2, 3], "SCALAR"),
    }
    made.add("meshes", primitives=[made.primitive(TRIANGLE + 1, [[0, 1, 2]]) for _ in range(2)])
    made.add("nodes", mesh=1, translation=[0, 3, 0], scale=[2, 2, 2], name="second")
    made.add("nodes", camera=0, name="eye", extras=[1])
    made.json["nodes"][0]["children"] = [1]
    made.json["scenes"][0] |= {"nodes": [0, 2], "name": "stage"}
    made.clip("fly", (2, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR"))
    return made


def without_additions(found, source):
    """Take away what injection may add, section by section; the rest must be the source."""
    rest = json.loads(json.dumps(found))
    for section in ("accessors", "bufferViews", "nodes", "animations"):
        rest[section] = rest[section][: len(source.get(section, []))]
    for section in source.keys() ^ rest.keys():
        assert section in ("skins", "animations", "nodes")
        rest.pop(section)
    for node in rest["nodes"]:
        node.pop("skin", None)
    for mesh in rest["meshes"]:
        for primitive in mesh["primitives"]:
            for name in ("JOINTS_0", "WEIGHTS_0"):
                primitive["attributes"].pop(name)
    for scene, before in zip(rest["scenes"], source["scenes"], strict=True):
        scene["nodes"] = scene["nodes"][: len(before["nodes"])]
    rest["buffers"][0]["byteLength"] = source["buffers"][0]["byteLength"]
    return rest


def test_the_document_differs_only_by_what_was_added(rng):
    content = made_rich().glb()
    figure = read_figure("rich.glb", content)
    source, source_bytes = opened(content)
    found, found_bytes = opened(encode_character(figure, make_character(figure.mesh, rng)))
    assert without_additions(found, source) == source
    assert list(found)[: len(source)] == list(source)
    length = source["buffers"][0]["byteLength"]
    assert found_bytes[:length] == source_bytes[:length]
    assert [clip["name"] for clip in found["animations"]] == ["fly", "dance"]


@pytest.mark.parametrize("roots", [1, 2])
@pytest.mark.parametrize("turned", [False, True])
def test_what_is_written_is_read_again(rng, roots, turned):
    turn = np.eye(4)
    if turned:
        turn[:3, :3] = 3 * vectors_to_matrices(np.array([[0.3, 1.0, -0.2]]))[0]
    figure = read_figure("rich.glb", made_rich().glb(), world_from_file=turn)
    character = make_character(figure.mesh, rng, roots)
    back = read_character("out.glb", encode_character(figure, character))
    file_from_world = np.linalg.inv(turn)
    expected = figure.mesh.vertices @ file_from_world[:3, :3].T
    np.testing.assert_allclose(back.mesh.vertices, expected, atol=1e-6)
    assert back.skeleton.names == character.skeleton.names
    np.testing.assert_array_equal(back.skeleton.parents, character.skeleton.parents)
    np.testing.assert_allclose(back.skin.weights, character.skin.weights, atol=1e-6)
    clip = next(clip for clip in back.clips if clip.name == "dance")
    np.testing.assert_allclose(clip.times, character.clips[0].times, atol=1e-6)
    posed = play_clip(character, character.clips[0]) @ file_from_world[:3, :3].T
    np.testing.assert_allclose(play_clip(back, clip), posed, atol=1e-5)


def test_the_same_input_gives_the_same_bytes(rng):
    figure = read_figure("rich.glb", made_rich().glb())
    character = make_character(figure.mesh, rng)
    assert encode_character(figure, character) == encode_character(figure, character)


def test_a_rig_is_replaced(rng):
    made = made_arm()
    made.json["nodes"][1]["extras"] = {"keep": "me"}
    made.add("nodes", name="light", translation=[0, 1, 0])
    made.json["scenes"][0]["nodes"].append(3)
    made.clip(
        "mixed",
        (2, "scale", [0, 1], np.ones((2, 3)), "LINEAR"),
        (3, "translation", [0, 1], np.ones((2, 3)), "LINEAR"),
    )
    figure = read_figure("arm.glb", made.glb())
    character = make_character(figure.mesh, rng)
    found, _ = opened(encode_character(figure, character))
    assert len(found["skins"]) == 1
    assert found["skins"][0]["joints"] == [4, 5]
    assert [clip["name"] for clip in found["animations"]] == ["mixed", "dance"]
    assert found["animations"][0]["channels"] == [
        {"sampler": 0, "target": {"node": 3, "path": "translation"}}
    ]
    assert len(found["animations"][0]["samplers"]) == 1
    assert found["nodes"][1] == {"name": "shoulder", "extras": {"keep": "me"}}  # elbow is hidden
    assert found["nodes"][2]["name"] == "elbow"
    assert found["scenes"][0]["nodes"] == [0, 1, 3, 4]
    back = read_character("out.glb", encode_character(figure, character))
    np.testing.assert_allclose(back.skin.weights, character.skin.weights, atol=1e-6)


def test_no_old_set_of_weights_is_left(rng):
    made = made_arm()
    attributes = made.json["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"JOINTS_1": attributes["JOINTS_0"], "WEIGHTS_1": attributes["WEIGHTS_0"]}
    figure = read_figure("arm.glb", made.glb())
    found, _ = opened(encode_character(figure, make_character(figure.mesh, rng)))
    names = set(found["meshes"][0]["primitives"][0]["attributes"])
    assert names == {"POSITION", "JOINTS_0", "WEIGHTS_0"}


def test_a_mesh_that_two_nodes_show_is_copied(rng):
    made = made_triangle()
    made.json["meshes"][0]["name"] = "twin"
    made.add("nodes", mesh=0, translation=[5, 0, 0])
    made.json["scenes"][0]["nodes"].append(1)
    figure = read_figure("twins.glb", made.glb())
    character = make_character(figure.mesh, rng)
    found, _ = opened(encode_character(figure, character))
    first, second = (found["meshes"][found["nodes"][node]["mesh"]] for node in (0, 1))
    assert first["name"] == second["name"] == "twin"
    first, second = first["primitives"][0], second["primitives"][0]
    assert first["attributes"]["POSITION"] == second["attributes"]["POSITION"]
    assert first["indices"] == second["indices"]
    assert first["attributes"]["WEIGHTS_0"] != second["attributes"]["WEIGHTS_0"]
    assert found["nodes"][0]["skin"] != found["nodes"][1]["skin"]  # they stand elsewhere


def test_meshes_that_stand_alike_share_a_skin(rng):
    made = made_triangle()
    made.add("meshes", primitives=[made.primitive(TRIANGLE + 1, [[0, 1, 2]])])
    made.add("nodes", mesh=1)
    made.json["scenes"][0]["nodes"].append(1)
    figure = read_figure("two.glb", made.glb())
    found, _ = opened(encode_character(figure, make_character(figure.mesh, rng)))
    assert len(found["skins"]) == 1


def test_lines_follow_the_nearest_surface(rng):
    made = made_triangle()
    line = made.primitive(TRIANGLE[[2, 0]] + np.float32(0.01)) | {"mode": 1}
    made.json["meshes"][0]["primitives"].append(line)
    figure = read_figure("line.glb", made.glb())
    character = make_character(figure.mesh, rng)
    content = encode_character(figure, character)
    document = read_document("out.glb", content)
    attributes = document.gltf.meshes[0].primitives[1].attributes
    from bunraku.formats.gltf.accessors import read_floats, read_integers

    weights = read_floats(document, attributes["WEIGHTS_0"], 4)
    joints = read_integers(document, attributes["JOINTS_0"], 4)
    heavy = character.skin.weights[[2, 0]]
    np.testing.assert_allclose(weights[:, 0], heavy.max(axis=1), atol=1e-6)
    np.testing.assert_array_equal(joints[:, 0], heavy.argmax(axis=1))


def test_files_beside_the_document_come_into_the_glb(tmp_path, rng):
    made = made_triangle()
    made.json["images"] = [{"uri": "skin.png"}, {"uri": "gone.png"}]
    made.glb()
    made.json["buffers"][0] |= {"uri": "t.bin", "name": "numbers"}
    (tmp_path / "t.bin").write_bytes(made.binary)
    (tmp_path / "skin.png").write_bytes(PNG)
    (tmp_path / "t.gltf").write_text(json.dumps(made.json))
    figure = read_figure(tmp_path / "t.gltf")
    found, binary = opened(encode_character(figure, make_character(figure.mesh, rng)))
    assert found["buffers"] == [
        {"byteLength": found["buffers"][0]["byteLength"], "name": "numbers"}
    ]
    view = found["bufferViews"][found["images"][0]["bufferView"]]
    start = view["byteOffset"]
    assert binary[start : start + view["byteLength"]] == PNG
    assert found["images"][0]["mimeType"] == "image/png"
    assert found["images"][1] == {"uri": "gone.png"}


def test_several_buffers_become_one(rng):
    made = made_triangle()
    expected = read_figure("t.glb", made.glb()).mesh.vertices
    import base64

    parts = bytes(made.binary[:36]), bytes(made.binary[36:])
    made.json["buffers"] = [
        {
            "byteLength": len(part),
            "uri": "data:application/octet-stream;base64," + base64.b64encode(part).decode(),
        }
        for part in parts
    ]
    made.json["bufferViews"][1] |= {"buffer": 1, "byteOffset": 0}
    figure = read_figure("t.gltf", json.dumps(made.json).encode())
    content = encode_character(figure, make_character(figure.mesh, rng))
    np.testing.assert_allclose(read_figure("out.glb", content).mesh.vertices, expected, atol=1e-6)
    assert len(opened(content)[0]["buffers"]) == 1


def test_bones_that_an_extension_names_stay_shown(rng):
    made = made_arm()
    bones = {"humanBones": {"hips": {"node": 1}, "head": {"node": 2}}}
    made.json |= {
        "extensionsUsed": ["VRMC_vrm"],
        "extensions": {"VRMC_vrm": {"specVersion": "1.0", "humanoid": bones}},
    }
    figure = read_figure("avatar.vrm", made.glb())
    found, _ = opened(encode_character(figure, make_character(figure.mesh, rng)))
    assert found["extensions"] == made.json["extensions"]
    assert found["nodes"][1]["children"] == [2]
    assert 1 in found["scenes"][0]["nodes"]


def test_a_file_without_a_scene_gets_one(rng):
    made = made_triangle()
    del made.json["scenes"], made.json["scene"]
    figure = read_figure("t.glb", made.glb())
    found, _ = opened(encode_character(figure, make_character(figure.mesh, rng)))
    assert found["scenes"] == [{"nodes": [0, 1]}]


def test_a_figure_without_a_document_becomes_a_fresh_file(cube, rng):
    figure = Figure("cube.obj", cube, np.zeros(8, np.int64))
    character = make_character(cube, rng)
    back = read_character("out.glb", encode_character(figure, character))
    np.testing.assert_allclose(back.mesh.vertices, cube.vertices, atol=1e-7)
    np.testing.assert_array_equal(back.mesh.faces, cube.faces)
    posed = play_clip(back, back.clips[0])
    np.testing.assert_allclose(posed, play_clip(character, character.clips[0]), atol=1e-5)


def test_a_mesh_alone(cube):
    figure = read_figure("out.glb", encode_mesh(cube))
    np.testing.assert_array_equal(figure.mesh.vertices, cube.vertices)
    np.testing.assert_array_equal(figure.mesh.faces, cube.faces)


def test_a_point_cloud_alone_and_rigged(cube, rng):
    cloud = Mesh(cube.vertices, np.zeros((0, 3), np.int64))
    assert len(read_figure("out.glb", encode_mesh(cloud)).mesh.faces) == 0
    figure = Figure("cloud.ply", cloud, np.zeros(8, np.int64))
    back = read_character("out.glb", encode_character(figure, make_character(cloud, rng)))
    np.testing.assert_allclose(back.mesh.vertices, cube.vertices, atol=1e-7)


def test_indices_take_four_bytes_only_where_needed(rng):
    for count, code in ((65535, 5123), (65536, 5125)):
        faces = np.array([[0, 1, count - 1]])
        document = read_document("m.glb", encode_mesh(Mesh(rng.normal(size=(count, 3)), faces)))
        primitive = document.gltf.meshes[0].primitives[0]
        assert document.gltf.accessors[primitive.indices].component_type == code


def test_the_characters_mesh_must_be_the_figures(cube, rng):
    figure = read_figure("t.glb", made_triangle().glb())
    with pytest.raises(ValueError, match="the character has 8 vertices, the figure 3"):
        encode_character(figure, make_character(cube, rng))


def clip_of(times, *, translations=None, rotations=None):
    count = len(times)
    still = np.tile([0.0, 0, 0, 1], (count, 2, 1))
    return Clip(
        "c",
        np.array(times, float),
        np.tile([1.0, 0, 0], (count, 2, 1)) if translations is None else translations,
        still if rotations is None else rotations,
        np.ones((count, 2, 3)),
    )


def write_clip(clip):
    """Write a clip for two joints that rest at (1, 0, 0); give its animation and document."""
    rest = np.tile(np.eye(4), (2, 1, 1))
    rest[:, 0, 3] = 1
    figure = read_figure("t.glb", made_triangle().glb())
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), rest)
    skin = Skin(np.tile([1.0, 0], (3, 1)), np.tile(np.eye(4), (2, 1, 1)))
    content = encode_character(figure, Character(figure.mesh, skeleton, skin, (clip,)))
    return opened(content)[0]["animations"][0], read_document("out.glb", content)


def test_what_does_not_move_is_left_out():
    moving = np.tile([1.0, 0, 0], (3, 2, 1))
    moving[:, 1, 1] = [0, 1, 2]
    animation, document = write_clip(clip_of([0, 1, 2], translations=moving))
    assert [c["target"] for c in animation["channels"]] == [{"node": 2, "path": "translation"}]
    accessor = document.copy_json()["accessors"][animation["samplers"][0]["input"]]
    assert (accessor["min"], accessor["max"], accessor["count"]) == ([0.0], [2.0], 3)


def test_what_stands_still_elsewhere_has_two_keys():
    elsewhere = np.tile([[1.0, 0, 0], [1, 5, 0]], (3, 1, 1))
    animation, document = write_clip(clip_of([0, 1, 2], translations=elsewhere))
    assert [c["target"] for c in animation["channels"]] == [{"node": 2, "path": "translation"}]
    assert document.gltf.accessors[animation["samplers"][0]["output"]].count == 2


def test_a_clip_of_the_rest_pose_keeps_its_length():
    animation, document = write_clip(clip_of([0, 1, 2]))
    assert len(animation["channels"]) == 1
    accessor = document.copy_json()["accessors"][animation["samplers"][0]["input"]]
    assert accessor["max"] == [2.0]


def test_quaternions_never_jump_to_the_other_sign(rng):
    from bunraku.formats.gltf.accessors import read_floats

    angles = np.linspace(0, 3, 9)
    turns = np.zeros((9, 2, 4))
    turns[:, :, 1], turns[:, :, 3] = np.sin(angles)[:, None], np.cos(angles)[:, None]
    turns *= rng.choice([-1.0, 1.0], size=(9, 2, 1))
    animation, document = write_clip(clip_of(np.arange(9), rotations=turns))
    for sampler in animation["samplers"]:
        values = read_floats(document, sampler["output"], 4)
        assert (np.einsum("kc,kc->k", values[1:], values[:-1]) > 0).all()


def test_times_begin_at_zero_or_later_and_rise_in_single_precision():
    times = [-0.5, 0.0, 0.5, 0.5 + 1e-9]
    moving = np.tile(np.arange(4.0)[:, None, None], (1, 2, 3))
    animation, document = write_clip(clip_of(times, translations=moving))
    accessor = document.copy_json()["accessors"][animation["samplers"][0]["input"]]
    assert (accessor["min"], accessor["max"], accessor["count"]) == ([0.0], [1.0], 3)


def test_weights_sum_to_one_in_single_precision(rng):
    weights = rng.dirichlet(np.ones(300) / 10, size=200)
    joints, shares = strongest_influences(weights)
    assert shares.dtype == np.float32
    np.testing.assert_allclose(shares.astype(np.float64).sum(axis=1), 1.0, atol=1.2e-7)
    assert (np.diff(shares, axis=1) <= 1e-7).all()
    np.testing.assert_array_equal(joints[:, 0], weights.argmax(axis=1))
    assert (joints[shares == 0] == 0).all()


def test_more_than_256_joints_take_two_bytes(rng):
    figure = read_figure("t.glb", made_triangle().glb())
    count = 300
    skeleton = Skeleton(
        tuple(f"j{i}" for i in range(count)),
        np.arange(-1, count - 1),
        np.tile(np.eye(4), (count, 1, 1)),
    )
    weights = np.zeros((3, count))
    weights[[0, 1, 2], [0, 150, 299]] = 1
    character = Character(figure.mesh, skeleton, Skin(weights, np.tile(np.eye(4), (count, 1, 1))))
    back = read_character("out.glb", encode_character(figure, character))
    np.testing.assert_array_equal(back.skin.weights, weights)


def test_every_chunk_is_padded_to_four_bytes(rng):
    figure = read_figure("t.glb", made_triangle().glb())
    content = encode_character(figure, make_character(figure.mesh, rng))
    assert len(content) % 4 == 0
    assert struct.unpack_from("<I", content, 8)[0] == len(content)
    assert struct.unpack_from("<I", content, 12)[0] % 4 == 0

from dataclasses import replace

import pytest

from bunraku import builtin
from bunraku.formats import read_figure
from bunraku.types import FormatError
from bunraku.verbs import performing


def test_no_name_means_every_clip():
    human = builtin.human()
    assert performing.choose_clips(human, None) == human.clips
    chosen = performing.choose_clips(human, ["walk", "idle", "walk"])
    assert [clip.name for clip in chosen] == ["walk", "idle"]


def test_a_clip_that_does_not_exist_names_those_that_do():
    with pytest.raises(FormatError, match="built-in human: has no clip 'fly'; it has 'idle', "):
        performing.choose_clips(builtin.human(), ["fly"])


def test_a_rig_without_clips_cannot_animate():
    silent = replace(builtin.human(), clips=())
    with pytest.raises(FormatError, match=r"rig\.glb: has a rig but no clips"):
        performing.choose_clips(silent, None, "rig.glb")


def test_a_recorded_motion_moves_the_built_in_human(tmp_path):
    path = tmp_path / "nod.bvh"
    path.write_text(HUMAN_BVH)
    performer = performing.read_performer(path)
    assert performer.mesh is builtin.human().mesh
    assert [len(clip.times) for clip in performer.clips] == [2]


def joint(name, offset, *children):
    inner = "\n".join(children) or "End Site\n{\nOFFSET 0 -0.1 0\n}"
    channels = "CHANNELS 3 Zrotation Xrotation Yrotation"
    return f"JOINT {name}\n{{\nOFFSET {offset}\n{channels}\n{inner}\n}}"


def limb(side, x, names, offset):
    nested = ""
    for name in reversed(names):
        place = offset if name != names[0] else f"{x} {offset.split()[1]} 0"
        nested = joint(side + name, place, *([nested] if nested else []))
    return nested


LEGS = [
    limb(s, x, ["UpLeg", "Leg", "Foot"], "0 -0.4 0") for s, x in (("Left", 0.1), ("Right", -0.1))
]
ARMS = [
    joint(
        f"{side}Arm",
        f"{0.2 * sign} 0.2 0",
        joint(f"{side}ForeArm", f"{0.3 * sign} 0 0", joint(f"{side}Hand", f"{0.25 * sign} 0 0")),
    )
    for side, sign in (("Left", 1), ("Right", -1))
]
TRUNK = joint("Spine", "0 0.2 0", joint("Neck", "0 0.3 0", joint("Head", "0 0.1 0")), *ARMS)
COUNT = 3 * (6 + 6 + 3)
HUMAN_BVH = (
    "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0.9 0\n"
    "CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\n"
    + "\n".join([*LEGS, TRUNK])
    + "\n}\nMOTION\nFrames: 2\nFrame Time: 0.0333333\n"
    + "\n".join(" ".join(["0 0.9 0 0 0 0", *["0"] * COUNT]) for _ in range(2))
    + "\n"
)


def test_landmarks_are_joints_and_places(tmp_path):
    path = tmp_path / "marks.json"
    path.write_text('{"hips": [0, 1, 0.5]}')
    for given in (path, str(path), {"hips": (0.0, 1.0, 0.5)}):
        assert performing.read_landmarks(given, builtin.human()) == {"hips": (0.0, 1.0, 0.5)}
    assert performing.read_landmarks(None, builtin.human()) is None


def test_landmarks_turn_with_a_figure_that_has_z_up(tmp_path):
    path = tmp_path / "stick.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 0 9\nf 1 2 3\n")
    for up, place in (("z", (1.0, 3.0, -2.0)), ("y", (1.0, 2.0, 3.0))):
        found = read_figure(path, up=up)
        assert performing.place_landmarks({"hips": (1.0, 2.0, 3.0)}, found) == {"hips": place}
    assert performing.place_landmarks(None, found) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('{"hips": [0, 1]}', 'must be {"joint name"'),
        ("[]", 'must be {"joint name"'),
        ('{"tail": [0, 1, 2]}', "/tail: no such joint; the performance has hips, "),
    ],
)
def test_wrong_landmarks_are_explained(tmp_path, text, words):
    path = tmp_path / "marks.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=rf"marks\.json: {words}"):
        performing.read_landmarks(path, builtin.human())

from dataclasses import replace

import numpy as np
import pytest

from bunraku import builtin
from bunraku.skinning import clip_transforms, forward_kinematics, play_clip
from bunraku.types import Clip
from bunraku.verbs.engines import ENGINES, name_bones, prepare_for

HUMAN = builtin.human()


def clip(character, name):
    return next(clip for clip in character.clips if clip.name.startswith(name))


@pytest.mark.parametrize("engine", [None, *ENGINES])
def test_no_vertex_moves(engine):
    prepared = prepare_for(HUMAN, engine)
    for name in ("walk", "jump"):
        frames = slice(0, None, 15)
        ours = play_clip(HUMAN, clip(HUMAN, name), frames)
        theirs = play_clip(prepared, clip(prepared, name), frames)
        np.testing.assert_allclose(theirs, ours, atol=1e-12)


@pytest.mark.parametrize(
    ("engine", "names"),
    [
        ("blender", {"hips", "upper_arm.L", "forearm.R", "toe.L", "upper_chest", "head"}),
        ("godot", {"Root", "Hips", "LeftUpperArm", "UpperChest"}),
        ("unity", {"Hips", "LeftUpperArm", "RightLowerLeg", "LeftToes"}),
        ("unreal", {"root", "pelvis", "spine_03", "upperarm_l", "calf_r", "ball_l", "neck_01"}),
    ],
)
def test_joints_have_the_names_an_engine_knows(engine, names):
    found = prepare_for(HUMAN, engine).skeleton.names
    assert names <= set(found)
    assert len(set(found)) == len(found)


@pytest.mark.parametrize(
    ("bone", "blender", "godot", "unity", "unreal"),
    [
        ("leftThumbMetacarpal", "thumb.01.L", *2 * ["LeftThumb"], "thumb_01_l"),
        ("leftThumbProximal", "thumb.02.L", *2 * ["LeftThumb"], "thumb_02_l"),
        ("leftThumbDistal", "thumb.03.L", *2 * ["LeftThumb"], "thumb_03_l"),
        ("rightLittleIntermediate", "f_pinky.02.R", *2 * ["RightLittle"], "pinky_02_r"),
        ("leftEye", "eye.L", *2 * ["LeftEye"], "leftEye"),
        ("jaw", "jaw", *2 * ["Jaw"], "jaw"),
    ],
)
def test_fingers_and_faces_are_named_too(bone, blender, godot, unity, unreal):
    assert ENGINES["blender"][0](bone) == blender
    assert ENGINES["unreal"][0](bone) == unreal
    assert ENGINES["godot"][0](bone).startswith(godot)
    assert ENGINES["unity"][0](bone).startswith(unity)


@pytest.mark.parametrize("engine", ENGINES)
def test_the_bones_are_found_again_under_their_new_names(engine):
    """A VRM can be written for an engine."""
    prepared = prepare_for(HUMAN, engine)
    shift = len(prepared.skeleton.names) - len(HUMAN.skeleton.names)
    ours = {bone: joint + shift for bone, joint in name_bones(HUMAN.skeleton).items()}
    assert name_bones(prepared.skeleton) == ours


def test_thumbs_differ_between_unity_and_godot():
    thumb = [f"leftThumb{part}" for part in ("Metacarpal", "Proximal", "Distal")]
    assert [ENGINES["godot"][0](bone)[9:] for bone in thumb] == ["Metacarpal", "Proximal", "Distal"]
    assert [ENGINES["unity"][0](bone)[9:] for bone in thumb] == [
        "Proximal",
        "Intermediate",
        "Distal",
    ]


@pytest.mark.parametrize("engine", ["godot", "unreal"])
def test_the_root_carries_the_way_along_the_floor(engine):
    moved = prepare_for(HUMAN, engine)
    walk = clip(moved, "walk")
    root = walk.translations[:, 0]
    assert np.ptp(root[:, 2]) > 1.0
    assert np.ptp(root[:, 1]) == 0.0
    assert np.ptp(walk.translations[:, 1, 2]) < 1e-9  # the hips go no way of their own
    np.testing.assert_array_equal(moved.skeleton.rest[0], np.eye(4))


def test_loops_are_marked_for_godot_and_others_are_not():
    names = {clip.name for clip in prepare_for(HUMAN, "godot").clips}
    assert {"walk-loop", "run-loop", "idle-loop"} <= names
    assert {"sitDown", "turn"} <= names
    again = replace(HUMAN, clips=(replace(clip(HUMAN, "walk"), name="walk-loop"),))
    assert [clip.name for clip in prepare_for(again, "godot").clips] == ["walk-loop"]


def test_a_rig_that_is_no_humans_keeps_its_names(creature):
    moved = prepare_for(creature, "unreal")
    assert moved.skeleton.names == ("root", *creature.skeleton.names)
    wave = creature.clips[0]
    ours = forward_kinematics(creature.skeleton.parents, clip_transforms(wave))
    theirs = forward_kinematics(moved.skeleton.parents, clip_transforms(moved.clips[0]))
    np.testing.assert_allclose(theirs[:, 1:], ours, atol=1e-12)


def test_a_joint_that_bears_a_taken_name_steps_aside():
    names = ("Hips", *HUMAN.skeleton.names[1:-1], "pelvis")
    odd = replace(HUMAN, skeleton=replace(HUMAN.skeleton, names=names))
    found = prepare_for(odd, "unreal").skeleton.names
    assert len(set(found)) == len(found)
    assert "pelvis" in found


def test_a_single_frame_is_no_loop():
    walk = clip(HUMAN, "walk")
    parts = (walk.translations[:1], walk.rotations[:1], walk.scales[:1])
    still = replace(HUMAN, clips=(Clip("still", walk.times[:1], *parts),))
    assert prepare_for(still, "godot").clips[0].name == "still"


def test_an_unknown_engine_is_named():
    with pytest.raises(ValueError, match="no preset for 'doom'; there are blender, godot"):
        prepare_for(HUMAN, "doom")

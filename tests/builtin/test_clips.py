"""What makes the built-in clips natural, in numbers."""

from functools import cache

import numpy as np
import pytest

from bunraku.builtin import human
from bunraku.rotations import quaternions_to_matrices, rotation_angles
from bunraku.skinning import clip_transforms, forward_kinematics, play_clip
from bunraku.types import Clip

WANTED = {"idle", "walk", "run", "jump", "wave", "dance", "sitDown", "turn"}
NAMES = [clip.name for clip in human().clips]
LOOPS = ("idle", "walk", "run", "dance")
GROUND = 0.008  # a sole lower than this, in metres, stands
SIDES = ("left", "right")


def clip_named(name: str) -> Clip:
    return human().clips[NAMES.index(name)]


@cache
def joints(clip: str) -> dict[str, np.ndarray]:
    """Give world_from_joint of every frame, by name of the joint."""
    skeleton = human().skeleton
    world = forward_kinematics(skeleton.parents, clip_transforms(clip_named(clip)))
    return {name: world[:, i] for i, name in enumerate(skeleton.names)}


def place(clip: str, joint: str) -> np.ndarray:
    return joints(clip)[joint][:, :3, 3]


@cache
def soles(clip: str, side: str) -> np.ndarray:
    """Give the points under a foot in every frame."""
    names, mesh = human().skeleton.names, human().mesh
    foot = [names.index(side + part) for part in ("Foot", "Toes")]
    under = (human().skin.weights[:, foot].sum(axis=1) > 0.95) & (mesh.vertices[:, 1] < 0.012)
    return moved(clip)[:, under]


@cache
def moved(clip: str) -> np.ndarray:
    return play_clip(human(), clip_named(clip))


def bend(clip: str, names: tuple[str, str, str]) -> np.ndarray:
    """Give the angle between two bones in degrees; 0 is straight."""
    first, second, third = (place(clip, name) for name in names)
    one, two = second - first, third - second
    cosine = (one * two).sum(-1) / np.linalg.norm(one, axis=-1) / np.linalg.norm(two, axis=-1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def stands(clip: str, side: str) -> np.ndarray:
    return (soles(clip, side)[..., 1] < GROUND).any(axis=1)


def slides(clip: str, side: str) -> list[float]:
    """Sum, over each time a foot stands, how far its most restful point of contact moves.

    A foot that rolls over heel or ball has one point at rest at a time; one that slides has none.
    """
    points = soles(clip, side)
    low = points[..., 1] < GROUND
    steps, both = np.linalg.norm(np.diff(points[..., [0, 2]], axis=0), axis=-1), low[1:] & low[:-1]
    totals = [0.0]
    for step, contact in zip(steps, both, strict=True):
        if contact.any():
            totals[-1] += float(step[contact].min())
        elif totals[-1] > 0:
            totals.append(0.0)
    return totals


def correlation(first: np.ndarray, second: np.ndarray) -> float:
    return float(np.corrcoef(first, second)[0, 1])


def ahead(clip: str, joint: str) -> np.ndarray:
    return place(clip, joint)[:, 2] - place(clip, "hips")[:, 2]


def test_all_wanted_clips_are_there():
    assert set(NAMES) >= WANTED


@pytest.mark.parametrize("name", NAMES)
def test_clip_runs_at_thirty_frames_and_changes_no_bone_length(name):
    clip = clip_named(name)
    assert np.allclose(np.diff(clip.times), 1 / 30)
    assert (clip.scales == 1).all()
    assert (clip.translations[:, 1:] == clip.translations[:1, 1:]).all()


@pytest.mark.parametrize("name", NAMES)
def test_planted_feet_slide_less_than_a_centimetre_a_step(name):
    for side in SIDES:
        assert max(slides(name, side)) < 0.01


@pytest.mark.parametrize("name", NAMES)
def test_nothing_sinks_into_the_ground(name):
    assert moved(name)[..., 1].min() > -0.01


@pytest.mark.parametrize("name", LOOPS)
def test_loop_closes_up_to_its_travel(name):
    clip = clip_named(name)
    first, last = quaternions_to_matrices(clip.rotations[[0, -1]])
    assert rotation_angles(np.swapaxes(first, -1, -2) @ last).max() < np.radians(0.1)
    travel = clip.translations[-1, 0] - clip.translations[0, 0]
    assert abs(travel[:2]).max() < 1e-3
    assert (travel[2] > 1) == (name in ("walk", "run"))


@pytest.mark.parametrize("name", LOOPS)
def test_loop_keeps_its_speed_across_the_seam(name):
    hips = clip_named(name).translations[:, 0]
    steps = np.diff(hips, axis=0)
    usual = np.linalg.norm(np.diff(steps, axis=0), axis=1).max()
    assert np.linalg.norm(steps[0] - steps[-1]) <= 1.2 * usual + 1e-4


@pytest.mark.parametrize("name", NAMES)
def test_knees_and_elbows_bend_the_right_way_and_no_further_than_they_can(name):
    for side in SIDES:
        leg = side + "UpperLeg", side + "LowerLeg", side + "Foot"
        arm = side + "UpperArm", side + "LowerArm", side + "Hand"
        assert bend(name, leg).min() > 4 and bend(name, leg).max() < 150
        assert bend(name, arm).min() > 4 and bend(name, arm).max() < 150
        thigh = place(name, leg[1]) - place(name, leg[0])
        shin = place(name, leg[2]) - place(name, leg[1])
        leftwards = joints(name)["hips"][:, :3, 0]
        assert (np.cross(thigh, shin) * leftwards).sum(axis=-1).min() > 0


@pytest.mark.parametrize("name", NAMES)
def test_no_joint_turns_further_or_faster_than_a_body_can(name):
    limits = {"Toes": 60, "Foot": 60, "Hand": 75, "neck": 50, "head": 50, "chest": 50, "spine": 50}
    rotations = quaternions_to_matrices(clip_named(name).rotations)
    angles = np.degrees(rotation_angles(rotations)).max(axis=0)
    for joint, angle in zip(human().skeleton.names, angles, strict=True):
        ending = next((end for end in limits if joint.endswith(end)), None)
        if ending:
            assert angle < limits[ending], joint
    steps = rotation_angles(np.swapaxes(rotations[:-1], -1, -2) @ rotations[1:])
    assert np.degrees(steps).max() < 40


@pytest.mark.parametrize("name", ["walk", "run"])
def test_arms_swing_against_legs(name):
    for side, other in (("left", "right"), ("right", "left")):
        hand = ahead(name, side + "Hand")
        assert correlation(hand, ahead(name, other + "Foot")) > 0.8
        assert correlation(hand, ahead(name, side + "Foot")) < -0.7


@pytest.mark.parametrize(("name", "least", "most"), [("walk", 0.02, 0.06), ("run", 0.04, 0.10)])
def test_hips_bob_twice_a_cycle(name, least, most):
    height = clip_named(name).translations[:-1, 0, 1]
    strength = np.abs(np.fft.rfft(height - height.mean()))
    assert strength.argmax() == 4  # two cycles, two steps each
    assert least < np.ptp(height) < most


def test_hips_sway_over_the_foot_that_stands():
    hips = place("walk", "hips")[:, 0]
    left, right = stands("walk", "left"), stands("walk", "right")
    assert hips[left & ~right].mean() > 0.008
    assert hips[right & ~left].mean() < -0.008


def test_shoulders_turn_against_the_pelvis_and_the_head_stays():
    yaw = {}
    for joint in ("hips", "upperChest", "head"):
        forward = joints("walk")[joint][:, :3, 2]
        yaw[joint] = np.degrees(np.arctan2(forward[:, 0], forward[:, 2]))
    assert correlation(yaw["hips"], yaw["upperChest"]) < -0.8
    assert np.ptp(yaw["head"]) < np.ptp(yaw["hips"]) / 3


def test_walking_always_stands_and_running_flies():
    assert (stands("walk", "left") | stands("walk", "right")).all()
    assert (stands("walk", "left") & stands("walk", "right")).mean() > 0.1
    assert not (stands("run", "left") & stands("run", "right")).any()
    assert 0.1 < (~stands("run", "left") & ~stands("run", "right")).mean() < 0.5


def test_foot_lands_on_the_heel_and_leaves_from_the_toes():
    points, standing = soles("walk", "left"), stands("walk", "left")
    order = human().mesh.vertices[:, 2]
    names = human().skeleton.names
    foot = [names.index("left" + part) for part in ("Foot", "Toes")]
    under = human().skin.weights[:, foot].sum(axis=1) > 0.95
    under &= human().mesh.vertices[:, 1] < 0.012
    order = order[under]
    heel, toe = points[:, order.argmin(), 1], points[:, order.argmax(), 1]
    landing = np.flatnonzero(standing[1:] & ~standing[:-1])[0] + 1
    leaving = np.flatnonzero(~standing[1:] & standing[:-1])[0]
    assert heel[landing] < toe[landing] - 0.02
    assert toe[leaving] < heel[leaving] - 0.05


@pytest.mark.parametrize("name", ["idle", "walk", "wave", "turn", "jump"])
def test_arms_hang_at_the_sides_with_easy_elbows(name):
    arm = (place(name, "leftLowerArm") - place(name, "leftUpperArm"))[0]
    downward = np.degrees(np.arccos(-arm[1] / np.linalg.norm(arm)))
    assert downward < 35
    assert 8 < bend(name, ("leftUpperArm", "leftLowerArm", "leftHand"))[0] < 40


def test_jump_leaves_the_ground_on_a_parabola():
    flying = ~stands("jump", "left") & ~stands("jump", "right")
    assert 0.3 < flying.sum() / 30 < 0.7
    height = place("jump", "hips")[flying, 1][1:-1]
    assert np.diff(height, 2).mean() * 900 == pytest.approx(-9.81, rel=0.1)


def test_jump_gathers_before_and_gives_way_after():
    height = place("jump", "hips")[:, 1]
    flying = np.flatnonzero(~stands("jump", "left"))
    for part in (height[: flying[0]], height[flying[-1] :]):
        assert part.min() < height[0] - 0.15


def test_sitting_ends_with_level_thighs_and_upright_back():
    thigh = (place("sitDown", "leftLowerLeg") - place("sitDown", "leftUpperLeg"))[-1]
    back = (place("sitDown", "neck") - place("sitDown", "hips"))[-1]
    assert abs(np.degrees(np.arcsin(thigh[1] / np.linalg.norm(thigh)))) < 15
    assert np.degrees(np.arccos(back[1] / np.linalg.norm(back))) < 15


def test_turn_ends_facing_back():
    assert joints("turn")["hips"][-1, 2, 2] == pytest.approx(-1, abs=1e-3)
    assert joints("turn")["head"][-1, 2, 2] < -0.99


def test_waving_hand_goes_over_the_head_and_to_and_fro():
    hand, head = place("wave", "rightHand"), place("wave", "head")
    up = hand[:, 1] > head[:, 1]
    sideways = np.diff(hand[up, 0])
    assert up.mean() > 0.3
    assert (np.diff(np.sign(sideways)) != 0).sum() >= 4


@pytest.mark.parametrize("name", NAMES)
def test_something_moves(name):
    assert np.abs(moved(name)[0] - moved(name)[len(moved(name)) // 3]).max() > 0.005

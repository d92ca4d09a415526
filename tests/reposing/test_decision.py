from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.registration.moments import no_moments
from bunraku.reposing.decision import (
    believe_turns,
    hang_on_hips,
    is_stood_on,
    limb_swings,
    limbs,
    nearby_quarter,
    off_symmetry,
    repose,
    scale_turns,
    smooth_step,
)
from bunraku.reposing.energy import place_joints
from bunraku.rotations import rotation_angles, vectors_to_matrices
from tests.creatures import JOINTS, NAMES, PARENTS, pose_of

STILL = np.zeros(3)
SMALL = {"leftArm": (0.0, 0.0, 4.0), "head": (3.0, 0.0, 0.0)}
LARGE = {
    "chest": (0.0, 30.0, 0.0),
    "leftArm": (0.0, 0.0, 60.0),
    "rightArm": (0.0, 40.0, 0.0),
    "leftLeg": (-50.0, 0.0, 0.0),
    "rightLeg": (30.0, 0.0, 0.0),
}
ONE_ARM = {"leftArm": (0.0, 0.0, 60.0)}
LIMBS = ("leftArm", "rightArm", "leftLeg", "rightLeg")


def turn(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def degrees(turns: np.ndarray) -> np.ndarray:
    return np.rad2deg(rotation_angles(turns))


def world_turns(angles: dict[str, tuple[float, float, float]]) -> np.ndarray:
    return place_joints(JOINTS, PARENTS, pose_of(angles), STILL)[1]


@pytest.mark.parametrize(("found", "expected"), [(5, 0), (100, 90), (-95, -90), (170, 180)])
def test_a_heading_near_a_quarter_turn_is_that_quarter_turn(found, expected):
    difference = turn("y", -expected) @ nearby_quarter(turn("y", found))
    assert degrees(difference) < 1e-6


def test_between_quarter_turns_the_heading_is_kept():
    np.testing.assert_allclose(nearby_quarter(turn("y", 45)), turn("y", 45), atol=1e-12)


def test_a_smooth_step_rises_from_nought_to_one():
    values = [smooth_step(value, 2.0, 4.0) for value in (-1.0, 2.0, 2.5, 3.0, 3.5, 4.0, 9.0)]
    np.testing.assert_allclose(values, [0, 0, 0.15625, 0.5, 0.84375, 1, 1])


def test_half_a_turn_keeps_what_turned_as_one_in_one_piece():
    """A lean of the whole figure, half believed, is half a lean and no bent spine."""
    share = np.full(7, 0.5)
    halved = scale_turns(np.tile(turn("x", 30), (7, 1, 1)), share)
    np.testing.assert_allclose(halved, np.tile(turn("x", 15), (7, 1, 1)), atol=1e-9)
    found = world_turns(LARGE)
    np.testing.assert_allclose(scale_turns(found, np.ones(7)), found, atol=1e-9)
    np.testing.assert_allclose(scale_turns(found, np.zeros(7)), scale_turns(halved, share * 0))


def test_a_limb_of_one_bone_swings_with_its_surface(body):
    swings = limb_swings(body, world_turns({"leftArm": (0.0, 0.0, 60.0)}), JOINTS)
    arm = np.rad2deg(swings.pop(NAMES.index("leftArm")))
    assert 50 < arm <= 60
    np.testing.assert_allclose(list(swings.values()), 0, atol=1e-6)


def test_tips_without_surface_do_not_hide_a_limb(body):
    """Exporters end every chain with a joint that moves nothing."""
    arm = NAMES.index("leftArm")
    tipped = replace(
        body,
        joints=np.vstack([body.joints, body.joints[arm] + [0.3, 0.0, 0.0]]),
        parents=np.append(PARENTS, arm),
        carriers=np.append(PARENTS, arm),
        weights=np.insert(body.weights, 7, 0.0, axis=1),
        moments=no_moments(8),
    )
    turns = np.concatenate([world_turns(ONE_ARM), turn("z", 60)[None]])
    swings = limb_swings(tipped, turns, tipped.joints)
    assert swings[arm] == pytest.approx(limb_swings(body, world_turns(ONE_ARM), JOINTS)[arm])


@pytest.fixture(scope="module")
def jointed(body):
    """The creature with its limbs in two bones, the second one as heavy as the first."""
    limb = np.array([NAMES.index(name) for name in LIMBS])
    ends = JOINTS[limb] + [[0.35, 0.1, 0.0], [-0.35, 0.1, 0.0], [0.0, -0.7, 0.0], [0.0, -0.7, 0.0]]
    weights = np.hstack([body.weights, body.weights[:, limb] / 2])
    weights[:, limb] /= 2
    parents = np.concatenate([PARENTS, limb])
    return replace(
        body,
        joints=np.vstack([body.joints, ends]),
        parents=parents,
        carriers=parents,
        weights=weights,
        moments=no_moments(11),
    )


def swung(jointed, degrees: dict[str, float], *, foot: float = 1.0):
    """Swing arms about Z, legs about X; their second bone may be longer or shorter."""
    joints = jointed.joints.copy()
    turns = np.tile(np.eye(3), (11, 1, 1))
    for index, limb in enumerate(LIMBS):
        first = NAMES.index(limb)
        around = turn("z" if "Arm" in limb else "x", degrees.get(limb, 0.0))
        turns[[first, 7 + index]] = around
        joints[7 + index] = joints[first] + foot * around @ (joints[7 + index] - joints[first])
    return turns, joints


def test_a_limb_swings_as_far_as_its_end_does(jointed):
    swings = limb_swings(jointed, *swung(jointed, {"leftLeg": 30.0}, foot=1.7))
    leg = np.rad2deg(swings.pop(NAMES.index("leftLeg")))
    assert leg == pytest.approx(30.0)
    assert len(swings) == 3
    np.testing.assert_allclose(list(swings.values()), 0, atol=1e-6)


def test_a_long_foot_on_a_short_leg_is_no_swing(jointed):
    """The direction to the end is the one it had with the source's bone lengths."""
    parents = np.append(jointed.parents, 9)  # a foot forward, below the left leg's second bone
    foot = jointed.joints[9] + [0.0, 0.0, 0.2]
    weights = np.hstack([jointed.weights, jointed.weights[:, 9:10] / 2])
    weights[:, 9] /= 2
    joints = np.vstack([jointed.joints, foot])
    footed = replace(
        jointed,
        joints=joints,
        parents=parents,
        carriers=parents,
        weights=weights,
        moments=no_moments(12),
    )
    chibi = joints.copy()
    chibi[9] = chibi[5] + (chibi[9] - chibi[5]) / 3
    chibi[11] = chibi[9] + [0.0, 0.0, 0.4]
    assert NAMES[5] == "leftLeg"
    swings = limb_swings(footed, np.tile(np.eye(3), (12, 1, 1)), chibi)
    assert swings[5] == pytest.approx(0.0, abs=1e-6)


def test_a_figure_is_posed_if_its_legs_swung(jointed):
    """The mean turn stays under its bar: the legs alone tell."""
    legs = {"leftLeg": 30.0, "rightLeg": -30.0}
    posed, share = believe_turns(jointed, *swung(jointed, legs), misfit=0.155)
    assert posed == 1.0 and share[0] == 1.0
    assert (share == 1.0).all()  # all limbs of a posed figure are, also those that hardly swung
    arms = {"leftArm": 50.0, "rightArm": 50.0}
    posed, share = believe_turns(jointed, *swung(jointed, arms), misfit=0.155)
    assert posed == 0.0 and share[0] == 0.0
    assert share[NAMES.index("leftArm")] == 1.0


def test_the_trunk_of_an_unlike_body_keeps_its_shape(jointed):
    legs = {"leftLeg": 30.0, "rightLeg": -30.0}
    posed, share = believe_turns(jointed, *swung(jointed, legs), misfit=0.25)
    assert share[NAMES.index("leftArm")] == 1.0
    trunk = [NAMES.index(name) for name in ("hips", "chest", "head")]
    assert posed == 1.0 and not share[trunk].any()
    assert share[NAMES.index("leftLeg")] == 1.0


def test_a_figure_stands_on_its_legs(body):
    stood_on = [is_stood_on(body, NAMES.index(limb)) for limb in LIMBS]
    assert stood_on == [False, False, True, True]


def test_small_parts_off_the_middle_are_no_limbs(body):
    light = body.weights.copy()
    arm, chest = NAMES.index("leftArm"), NAMES.index("chest")
    light[:, chest] += 0.9 * light[:, arm]
    light[:, arm] *= 0.1
    turns = world_turns(ONE_ARM)
    assert NAMES.index("leftArm") in limb_swings(body, turns, JOINTS)
    assert NAMES.index("leftArm") not in limb_swings(replace(body, weights=light), turns, JOINTS)


def test_arms_and_legs_lie_off_the_plane_of_symmetry(body):
    expected = [name.startswith(("left", "right")) for name in NAMES]
    vertices = body.proxy.mesh.vertices
    np.testing.assert_array_equal(off_symmetry(JOINTS, vertices), expected)
    assert [NAMES[limb] for limb in limbs(body)] == ["leftArm", "rightArm", "leftLeg", "rightLeg"]


def test_the_plane_of_symmetry_is_found_whichever_way_the_source_faces(body):
    left = turn("y", 90)
    off = off_symmetry(JOINTS @ left.T, body.proxy.mesh.vertices @ left.T)
    np.testing.assert_array_equal(off, off_symmetry(JOINTS, body.proxy.mesh.vertices))


def test_a_long_body_is_not_taken_for_a_wide_one():
    """Legs at both ends of a horse nearly mirror each other; its left and right do."""
    joints = np.array([[x, 0.0, z] for x in (-0.2, 0.2) for z in (-1.0, 0.9)])
    joints = np.vstack([joints, [[0, 1.0, 1.3], [0, 1.0, -1.0], [0, 1.0, 0.0]]])
    off = off_symmetry(joints, joints)
    np.testing.assert_array_equal(off, joints[:, 0] != 0)


def test_a_flat_rig_has_limbs_though_its_sides_differ_a_little(body):
    joints = JOINTS * [1.0, 1.0, 0.0]
    joints[NAMES.index("leftArm"), 0] += 1e-3
    off = off_symmetry(joints, body.proxy.mesh.vertices)
    np.testing.assert_array_equal(off, [name in LIMBS for name in NAMES])


def test_a_figure_at_rest_is_not_posed(body):
    posed, share = believe_turns(body, world_turns(SMALL), JOINTS, misfit=0.05)
    assert posed == 0.0 and not share.any()


def test_a_figure_in_motion_is_posed(body):
    posed, share = believe_turns(body, world_turns(LARGE), JOINTS, misfit=0.05)
    assert posed == 1.0 and (share == 1.0).all()


def test_one_raised_arm_is_the_pose_of_that_arm_alone(body):
    _, share = believe_turns(body, world_turns(ONE_ARM), JOINTS, misfit=0.2)
    assert share[NAMES.index("leftArm")] == 1.0
    assert share[NAMES.index("rightArm")] < 0.2 and share[NAMES.index("head")] < 0.2


def test_a_poor_fit_makes_turns_less_believed(body):
    """Over turns of every size: the worse the fit, the larger a turn must be."""
    sweep = [world_turns({"hips": (angle, 0.0, 0.0)}) for angle in np.linspace(0.0, 60.0, 31)]
    believed = [
        sum(believe_turns(body, turns, JOINTS, misfit=misfit)[0] for turns in sweep)
        for misfit in (0.05, 0.15, 0.3)
    ]
    assert believed[0] >= believed[1] >= believed[2] and believed[0] > believed[2] > 0


def test_reposing_undoes_heading_and_pose(body):
    heading, surface = turn("y", 90), world_turns(LARGE)
    posed, _ = place_joints(JOINTS, PARENTS, pose_of(LARGE), STILL)
    joints = posed @ heading.T
    found = repose(joints, body, heading @ surface, np.ones(7), misfit=0.05)
    np.testing.assert_allclose(found.heading, heading, atol=1e-9)
    assert found.posed == 1.0
    assert degrees(np.swapaxes(surface, 1, 2) @ found.turns).max() < 5
    back = found.places - found.places[0] + JOINTS[0]
    assert np.linalg.norm(back - JOINTS, axis=1).max() < 0.02
    np.testing.assert_array_equal(found.found, joints)


def test_limbs_are_told_in_the_figures_own_front(jointed):
    heading = turn("y", 90)
    legs = {"leftLeg": 30.0, "rightLeg": -30.0}
    arm = {"leftArm": 10.0}  # in the world's front it would seem to have swung by 90
    turns, joints = swung(jointed, legs | arm)
    found = repose(joints @ heading.T, jointed, heading @ turns, np.ones(11), misfit=0.3)
    assert found.posed == 1.0 and found.trunk == 0.0
    assert degrees(found.turns[[NAMES.index("leftArm")]]) < 11  # all limbs of a posed figure
    assert degrees(found.turns[[NAMES.index("leftLeg")]]) > 25
    alike = repose(joints @ heading.T, jointed, heading @ turns, np.ones(11), misfit=0.155)
    assert alike.posed == 1.0 and alike.trunk == 1.0


def test_reposing_a_figure_at_rest_changes_nothing(body):
    still = np.tile(np.eye(3), (7, 1, 1))
    found = repose(JOINTS, body, still, np.ones(7), misfit=0.05)
    np.testing.assert_allclose(found.turns, still, atol=1e-9)
    np.testing.assert_allclose(found.heading, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(found.places, JOINTS, atol=1e-9)


def test_what_is_taken_for_shape_stays_in_the_places(body):
    """A figure with lower arms at rest keeps them low: clips add to its own rest."""
    posed, _ = place_joints(JOINTS, PARENTS, pose_of(SMALL), STILL)
    found = repose(posed, body, world_turns(SMALL), np.ones(7), misfit=0.15)
    assert found.posed == 0.0
    np.testing.assert_allclose(found.places, posed, atol=1e-9)


def test_a_lone_root_stored_first_turns_with_the_figure(body):
    """An exporter's bone beside the figure: the way to rest and back keeps all roots together."""
    aside = np.array([0.6, 0.0, 0.3])
    rest = np.vstack([aside, JOINTS])
    parents = np.append(-1, np.where(PARENTS < 0, -1, PARENTS + 1))
    puppet = replace(body.puppet, joints=body.puppet.joints + 1)
    wider = replace(
        body,
        joints=rest,
        parents=parents,
        carriers=parents,
        puppet=puppet,
        weights=np.insert(body.weights, 0, 0.0, axis=1),
        moments=no_moments(8),
    )
    heading = turn("y", 90)
    surface = np.tile(heading, (8, 1, 1))
    found = repose(rest @ heading.T, wider, surface, np.append(0.0, np.ones(7)), misfit=0.05)
    np.testing.assert_allclose(found.heading, heading, atol=1e-9)
    np.testing.assert_allclose(found.places - found.places[1], rest - rest[1], atol=1e-6)


def test_a_floor_root_follows_the_hips_whatever_its_own_surface_says(body):
    """Placed, turned and trusted as if it were one with them, at the figure's size."""
    floor = np.array([0.1, 0.02, 0.05])
    parents = np.append(-1, PARENTS + 1)
    joints = np.vstack([floor, JOINTS])
    rooted = replace(
        body,
        joints=joints,
        parents=parents,
        carriers=parents,
        puppet=replace(body.puppet, joints=body.puppet.joints + 1),
        weights=np.insert(body.weights, 0, 0.0, axis=1),
        moments=no_moments(len(body.joints) + 1),
    )
    left = vectors_to_matrices(np.array([0.0, np.pi / 2, 0.0]))
    found = 2.0 * joints @ left.T
    found[0] = [9.0, 9.0, 9.0]
    turns = np.tile(left, (8, 1, 1))
    turns[0] = vectors_to_matrices(np.array([1.6, 0.0, 0.0]))
    trust = np.append(0.1, np.ones(7))
    placed, turned, trusted = hang_on_hips(found, rooted, turns, trust)
    np.testing.assert_allclose(placed, 2.0 * joints @ left.T, atol=1e-9)
    np.testing.assert_allclose(turned, np.tile(left, (8, 1, 1)), atol=1e-12)
    np.testing.assert_array_equal(trusted, np.ones(8))
    assert found[0, 0] == 9.0 and trust[0] == 0.1  # what was given stays as it is


def test_a_body_that_hangs_from_its_hips_is_left_alone(body):
    turns = np.tile(np.eye(3), (7, 1, 1))
    placed, turned, trusted = hang_on_hips(JOINTS, body, turns, np.ones(7))
    np.testing.assert_array_equal(placed, JOINTS)
    np.testing.assert_array_equal(turned, turns)
    np.testing.assert_array_equal(trusted, np.ones(7))

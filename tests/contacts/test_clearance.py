import numpy as np
import pytest
from trimesh.creation import box

from bunraku.contacts import Dressed, choose_moments, choose_swing, find_arms, swing_arm
from bunraku.contacts.clearance import Arm, inside_share
from bunraku.contacts.legs import Leg
from bunraku.rotations import compose_transforms, rotation_angles, vectors_to_matrices
from bunraku.types import Mesh

LEFT = Arm(1, 0, np.array([1, 2]), np.array([2]), 1.0)
JOINTS = np.array([[0.0, 1.0, 0.0], [0.3, 1.4, 0.0], [0.7, 1.4, 0.0]])
REST = compose_transforms(JOINTS, np.tile(np.eye(3), (3, 1, 1)))


def stout(width: float) -> Dressed:
    """A belly of some width, with a straight arm that sticks out to the left."""
    belly = box((width, 1.0, 0.6)).subdivide().subdivide()
    forearm = box((0.4, 0.08, 0.08)).subdivide().subdivide()
    vertices = np.vstack([belly.vertices, forearm.vertices])
    vertices[: len(belly.vertices), 1] += 0.9
    vertices[len(belly.vertices) :, :2] += [0.9, 1.4]
    faces = np.vstack([belly.faces, forearm.faces + len(belly.vertices)])
    owner = np.repeat([0, 2], [len(belly.vertices), len(forearm.vertices)])
    return Dressed(Mesh(vertices, faces.astype(np.int64)), np.eye(3)[owner], REST)


def hanging(angle: float, frames: int = 6) -> np.ndarray:
    """Let the arm hang down, turned by `angle` from the vertical, outwards."""
    return np.repeat(swing_arm(REST[None], REST, LEFT, angle - np.pi / 2), frames, axis=0)


def test_an_arm_swings_about_its_shoulder_by_hand():
    swung = swing_arm(REST[None], REST, LEFT, -np.pi / 2)[0]
    np.testing.assert_allclose(swung[:2, :3, 3], JOINTS[:2], atol=1e-12)
    np.testing.assert_allclose(swung[2, :3, 3], [0.3, 1.0, 0.0], atol=1e-12)
    right = Arm(1, 0, LEFT.below, LEFT.far, -1.0)
    up = swing_arm(REST[None], REST, right, -np.pi / 2)[0]
    np.testing.assert_allclose(up[2, :3, 3], [0.3, 1.8, 0.0], atol=1e-12)


def test_the_swing_turns_with_the_trunk():
    """A body that looks to its left swings its arm in the plane it looks along."""
    turn = compose_transforms(np.zeros(3), vectors_to_matrices(np.array([0.0, np.pi / 2, 0.0])))
    turned = swing_arm((turn @ REST)[None], REST, LEFT, 0.3)
    np.testing.assert_allclose(turned, turn @ swing_arm(REST[None], REST, LEFT, 0.3), atol=1e-12)


def test_what_is_inside_is_counted():
    assert inside_share(REST[None], LEFT, stout(0.5)) == 0.0
    assert inside_share(hanging(0.0), LEFT, stout(0.5)) == 0.0
    assert inside_share(hanging(0.0), LEFT, stout(1.2)) == 1.0
    half = np.concatenate([hanging(0.0, 2), hanging(np.pi / 2, 2)])
    assert inside_share(half, LEFT, stout(1.2)) == pytest.approx(0.5)


def test_an_arm_at_a_slim_body_is_left_alone():
    slim = stout(0.5)
    assert choose_swing(hanging(0.0), REST, LEFT, (slim, slim), hanging(0.0)) == 0.0


def test_an_arm_is_swung_out_of_a_belly_no_more_than_it_needs():
    """The middle of the hanging forearm is .3 m from the middle of the body."""
    wide, slim = stout(0.64), stout(0.5)
    angle = choose_swing(hanging(0.0), REST, LEFT, (wide, slim), hanging(0.0))
    assert np.rad2deg(angle) == pytest.approx(12.0)
    swung = swing_arm(hanging(0.0), REST, LEFT, angle)
    assert inside_share(swung, LEFT, wide) < 0.5 * inside_share(hanging(0.0), LEFT, wide)
    turned = np.swapaxes(hanging(0.0)[:, 2, :3, :3], 1, 2) @ swung[:, 2, :3, :3]
    np.testing.assert_allclose(rotation_angles(turned), angle)


def test_an_arm_that_is_in_the_sources_body_too_is_left_alone():
    wide = stout(0.64)
    assert choose_swing(hanging(0.0), REST, LEFT, (wide, wide), hanging(0.0)) == 0.0


def test_a_swing_that_does_not_help_is_not_made():
    huge, slim = stout(3.0), stout(0.5)
    assert choose_swing(hanging(0.0), REST, LEFT, (huge, slim), hanging(0.0)) == 0.0


def test_arms_are_found_by_name_unless_they_stand_on_the_ground():
    joints = np.vstack([JOINTS, JOINTS[1:] * [-1.0, 1.0, 1.0]])
    parents = np.array([-1, 0, 1, 0, 3])
    names = ("chest", "leftUpperArm", "leftLowerArm", "mixamorig:RightArm", "RightForeArm")
    left, right = find_arms(names, joints, parents, ())
    assert (left.shoulder, left.trunk, left.side) == (1, 0, 1.0)
    assert (right.shoulder, right.trunk, right.side) == (3, 0, -1.0)
    np.testing.assert_array_equal(right.below, [3, 4])
    np.testing.assert_array_equal(right.far, [4])
    none = np.empty(0, np.int64)
    foreleg = Leg(1, 1, 2, none, none, np.array([2]), np.array([2]))
    assert [arm.shoulder for arm in find_arms(names, joints, parents, (foreleg,))] == [3]
    wings = ("body", "wing_1_L", "wing_2_L", "wing_1_R", "wing_2_R")
    assert find_arms(wings, joints, parents, ()) == ()


def test_moments_are_spread_over_clips_and_frames():
    found = choose_moments([9] * 40)
    assert len(found) == 8 and {0, 39} <= set(found)
    np.testing.assert_array_equal(found[0], [2, 6])
    np.testing.assert_array_equal(choose_moments([1])[0], [0])

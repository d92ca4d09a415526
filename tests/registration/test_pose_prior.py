import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.registration.articulated import COARSE, fit
from bunraku.registration.correspondence import make_surface
from bunraku.registration.pose_prior import LEAST, USUAL, joint_stiffness, turns_at_moments
from bunraku.registration.puppet import Pose, learn_stiffness, move_puppet, rest_pose
from bunraku.rotations import rotation_angles, vectors_to_matrices
from tests.creatures import NAMES, PARENTS


def test_of_no_clips_every_joint_is_as_stiff_as_usual():
    np.testing.assert_array_equal(
        joint_stiffness(np.empty((0, 2, 3))), np.tile(np.eye(3), (2, 1, 1))
    )


def test_a_hinge_is_soft_about_its_axis_and_stiff_about_the_others():
    swing = np.deg2rad(50.0)
    turns = np.zeros((2, 3, 3))  # root first
    turns[0, 1, 0], turns[1, 1, 0] = swing, -swing  # joint 1 bends about x, joint 2 never turns
    _, hinge, still = joint_stiffness(turns)
    np.testing.assert_allclose(np.diag(hinge)[0], USUAL**2 / (swing**2 + LEAST**2))
    np.testing.assert_allclose(np.diag(hinge)[1:], USUAL**2 / LEAST**2)
    np.testing.assert_allclose(still, USUAL**2 / LEAST**2 * np.eye(3))


def test_being_turned_round_says_nothing_of_the_joints():
    turns = np.zeros((8, 3, 3))
    turns[:, 0, 1] = np.linspace(-3, 3, 8)
    stiffness = joint_stiffness(turns)
    assert (np.abs(np.linalg.eigvalsh(stiffness[1:]) - 1.0) < 0.15).all()


@pytest.mark.parametrize("breath", [0.0, 0.02])
def test_a_character_that_only_breathes_tells_little(rng, breath):
    stiffness = joint_stiffness(breath * rng.normal(size=(20, 3, 3)))
    told = (breath / USUAL) ** 2
    assert (np.abs(np.linalg.eigvalsh(stiffness) - 1.0) < 0.15 + 10 * told).all()


def test_turns_at_moments_are_taken_in_the_parents_frame(rng):
    world = Rotation.from_rotvec(rng.normal(size=(4 * 7, 3))).as_matrix().reshape(4, 7, 3, 3)
    local = turns_at_moments(world, PARENTS)
    np.testing.assert_allclose(local[:, 0], world[:, 0])
    again = world[:, PARENTS[1:]] @ local[:, 1:]
    np.testing.assert_allclose(again, world[:, 1:], atol=1e-12)


def test_a_turn_goes_to_the_joint_that_turns_in_the_clips(puppet, rng):
    """Chest and arm could both lift the hand; in the clips only the arm does."""
    arm, chest = (puppet.joints.tolist().index(NAMES.index(n)) for n in ("leftArm", "chest"))
    moments = np.tile(np.eye(3), (8, len(NAMES), 1, 1))
    moments[:, NAMES.index("leftArm")] = vectors_to_matrices(
        np.linspace(-1.0, 1.0, 8)[:, None] * [0.0, 0.0, 1.0]
    )
    turns = np.tile(np.eye(3), (len(puppet.joints), 1, 1))
    turns[arm] = vectors_to_matrices(np.array([0.0, 0.0, 0.8]))
    posed = Pose(rest_pose(puppet).root, turns, np.zeros((len(turns), 2)))
    surface = make_surface(move_puppet(puppet, posed)[0], puppet.faces)
    missed = [
        rotation_angles(turns @ np.swapaxes(found.rotations, 1, 2))[[arm, chest]].sum()
        for found in (
            fit(one, rest_pose(one), surface, COARSE)
            for one in (puppet, learn_stiffness(puppet, moments))
        )
    ]
    assert missed[1] < 0.8 * missed[0]

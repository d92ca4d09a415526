from dataclasses import replace

import numpy as np

from bunraku.registration.articulated import fit_error
from bunraku.registration.correspondence import make_surface
from bunraku.registration.mirroring import MIRROR, mirror_twins, swap_limbs
from bunraku.registration.puppet import move_puppet, rest_pose, step_pose
from bunraku.registration.search import Candidate, swapped_candidates
from bunraku.rotations import rotation_angles
from tests.creatures import NAMES


def test_twins_are_each_others_mirror_images():
    points = np.array([[1.0, 2, 0], [5, 1, 0], [-3, 1, 0], [1, 0, 0], [9, 9, 9]])
    np.testing.assert_array_equal(mirror_twins(points), [0, 2, 1, 3, 4])


def test_a_limb_without_an_image_has_no_twin():
    """A shoulder on one side, and something else lower down on the other."""
    points = np.array([[0.0, 1.0, 0], [0, 0.5, 0], [0, 0, 0], [0.5, 0.9, 0], [-0.6, 0.5, 0.2]])
    np.testing.assert_array_equal(mirror_twins(points), [0, 1, 2, 3, 4])


def number(puppet, name: str) -> int:
    return int(np.flatnonzero(puppet.joints == NAMES.index(name))[0])


def bent(puppet, **degrees: float):
    """Pose the puppet: limbs turned about x."""
    turns = np.zeros((len(puppet.joints), 3))
    for name, angle in degrees.items():
        turns[number(puppet, name), 0] = np.deg2rad(angle)
    still = np.zeros((len(turns), 2))
    return step_pose(puppet, rest_pose(puppet), turns, still, np.zeros(3))


def test_swapping_the_legs_of_a_runner_mirrors_them_and_nothing_else(puppet):
    runner = bent(puppet, leftLeg=40.0, rightLeg=-30.0, leftArm=10.0, head=5.0)
    swapped = list(swap_limbs(puppet, runner))
    assert len(swapped) == 2  # arms, legs
    expected = bent(puppet, leftLeg=-30.0, rightLeg=40.0, leftArm=10.0, head=5.0)
    apart = [
        rotation_angles(one.rotations @ np.swapaxes(expected.rotations, 1, 2)).max()
        for one in swapped
    ]
    assert min(apart) < 1e-6 < max(apart)


def test_a_swapped_limb_is_straight_below_its_top(puppet, somehow):
    """The creature's limbs have one joint; a leg of two loses its knee's turn."""
    twins = mirror_twins(puppet.anchors)
    parents = puppet.parents.copy()
    legs = [number(puppet, name) for name in ("leftLeg", "rightLeg")]
    arms = [number(puppet, name) for name in ("leftArm", "rightArm")]
    parents[arms] = legs  # as if the arms were shanks
    chained = replace(puppet, parents=parents)
    (swapped,) = swap_limbs(chained, somehow)
    np.testing.assert_array_equal(swapped.rotations[arms], np.tile(np.eye(3), (2, 1, 1)))
    np.testing.assert_array_equal(swapped.scales[legs], somehow.scales[twins[legs]])
    mirrored = MIRROR @ somehow.rotations[legs[::-1]] @ MIRROR
    np.testing.assert_array_equal(swapped.rotations[legs], mirrored)


def test_a_fit_with_its_legs_swapped_is_set_right(puppet):
    runner = bent(puppet, leftLeg=45.0, rightLeg=-45.0)
    wrong = bent(puppet, leftLeg=-45.0, rightLeg=45.0)
    surface = make_surface(move_puppet(puppet, runner)[0], puppet.faces)
    found = swapped_candidates(puppet, surface, Candidate(wrong, None, 0.3))
    best = min(found, key=lambda candidate: candidate.error)
    assert best.error < fit_error(puppet, wrong, surface)
    legs = [number(puppet, name) for name in ("leftLeg", "rightLeg")]
    turned = best.pose.world(puppet)[0] @ np.swapaxes(runner.world(puppet)[0], 1, 2)
    assert np.rad2deg(rotation_angles(turned[legs])).max() < 10

from dataclasses import replace

import numpy as np
import pytest

from bunraku.meshes import scale_to_unit_area
from bunraku.registration.articulated import FINE, fit, fit_error
from bunraku.registration.correspondence import Surface, make_surface
from bunraku.registration.extremities import (
    QUARTERS,
    between,
    in_box,
    limb_tips,
    pair_landmarks,
    reach_tips,
    remote_points,
    surface_tips,
    twin_tips,
)
from bunraku.registration.puppet import Pose, Puppet, move_puppet, rest_pose
from tests.creatures import NAMES

FRONT = QUARTERS[0]
SHORT_LEGS, BIG_HEAD = 0.5, 2.0


def joint_of(puppet: Puppet, name: str) -> int:
    return puppet.joints.tolist().index(NAMES.index(name))


@pytest.fixture(scope="module")
def truth(puppet) -> Pose:
    """The puppet with legs half as long and a head twice as large."""
    scales = np.zeros((len(puppet.parents), 2))
    for leg in ("leftLeg", "rightLeg"):
        scales[joint_of(puppet, leg), 0] = np.log(SHORT_LEGS)
    scales[joint_of(puppet, "head")] = np.log(BIG_HEAD)
    return replace(rest_pose(puppet), scales=scales)


@pytest.fixture(scope="module")
def stylised(puppet, truth) -> tuple[Surface, np.ndarray]:
    """Its surface at area 1, and its joints there."""
    grown, centre, scale = scale_to_unit_area(move_puppet(puppet, truth)[0], puppet.faces)
    return make_surface(grown, puppet.faces), (truth.world(puppet)[2] - centre) / scale


def by_place(puppet: Puppet, tips: np.ndarray) -> dict[str, np.ndarray]:
    """Give the tips by the joint that moves each most."""
    owner = puppet.weights[tips].argmax(axis=1)
    return {NAMES[puppet.joints[j]]: puppet.vertices[t] for j, t in zip(owner, tips, strict=True)}


def test_a_landmark_beyond_a_hand_is_no_tip(puppet):
    hand = joint_of(puppet, "leftArm")
    marked = replace(
        puppet,
        vertices=np.vstack([puppet.vertices, puppet.anchors[hand] + [5.0, 0, 0]]),
        weights=np.vstack([puppet.weights, np.eye(len(puppet.joints))[hand]]),
    )
    np.testing.assert_array_equal(limb_tips(marked), limb_tips(puppet))


def test_each_limb_has_its_tip_and_the_trunk_none(puppet):
    tips = by_place(puppet, limb_tips(puppet))
    assert set(tips) == {"head", "leftArm", "rightArm", "leftLeg", "rightLeg"}
    high, wide = puppet.vertices[:, 1], puppet.vertices[:, 0]
    assert np.isclose(tips["leftArm"][0], wide.max(), atol=0.02)
    assert np.isclose(tips["rightArm"][0], wide.min(), atol=0.02)
    assert np.isclose(tips["leftLeg"][1], high.min(), atol=0.08) and tips["leftLeg"][0] > 0
    assert tips["head"][2] > puppet.anchors[0, 2] + 0.1 or tips["head"][1] > high.max() - 0.05


def strip() -> tuple[np.ndarray, np.ndarray]:
    """A row of ten triangles, five metres long."""
    vertices = np.column_stack([np.repeat(np.arange(6.0), 2), np.tile([0.0, 0.1], 6), np.zeros(12)])
    first = np.arange(0, 10, 2)
    lower = np.column_stack([first, first + 2, first + 1])
    return vertices, np.concatenate([lower, np.column_stack([first + 1, first + 2, first + 3])])


def test_the_ends_of_a_strip_are_its_extremities():
    vertices, faces = strip()
    tips = remote_points(vertices, faces, 2)
    assert sorted(vertices[tips, 0]) == [0, 5]


def test_extremities_of_the_creature_are_its_limbs(puppet):
    """Hands, feet, head and tail, the most remote first; more of them only adds to the list."""
    tips = remote_points(puppet.vertices, puppet.faces, 8)
    owners = {NAMES[j] for j in puppet.joints[puppet.weights[tips].argmax(axis=1)]}
    assert {"head", "leftArm", "rightArm", "leftLeg", "rightLeg"} <= owners
    np.testing.assert_array_equal(remote_points(puppet.vertices, puppet.faces, 3), tips[:3])


def test_a_part_that_cannot_be_reached_has_no_extremity():
    strip = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    vertices = np.vstack([strip, strip * 0.1 + 0.1])
    tips = remote_points(vertices, np.array([[0, 1, 2], [3, 4, 5]]), 2)
    assert set(tips) < {0, 1, 2} or set(tips) < {3, 4, 5}


def test_places_in_a_box_by_hand():
    """Height by height, width and depth by the wider of the two."""
    box = np.array([[-1.0, 0.0, -3.0], [1.0, 2.0, 3.0]])
    points = np.array([[0.0, 1, 0], [1, 2, 3], [-1, 0, -3]])
    np.testing.assert_allclose(in_box(points, box), [[0, 0, 0], [1 / 3, 1, 1], [-1 / 3, -1, -1]])


def test_places_in_a_box_do_not_depend_on_size_and_position(puppet, rng):
    points = rng.normal(size=(5, 3))
    moved, around = 3.0 * points + 7.0, 3.0 * puppet.vertices + 7.0
    np.testing.assert_allclose(in_box(moved, around), in_box(points, puppet.vertices))
    assert np.isfinite(in_box(points, np.zeros((1, 3)))).all()


def test_twins_by_hand():
    """Two hands mirror each other; a head is nobody's twin; a lone ear neither."""
    box = np.array([[-1.0, -1, -1], [1, 1, 1]])
    tips = np.array([[0.9, 0, 0], [0, 1, 0], [-0.9, 0.05, 0], [0.3, 0.9, 0], [0.5, -1, 0.4]])
    assert twin_tips(tips, box) == [(0, 2)]
    assert twin_tips(tips[:0], box) == []


def test_halfway_between_the_ends_of_a_strip():
    """The middle of the way, not the middle of the list."""
    vertices, faces = strip()
    middle, near = between(vertices, faces, np.array([[0, 8], [0, 4]]))
    assert vertices[middle, 0] == 2 and vertices[near, 0] == 1


def test_between_the_feet_lies_the_crotch(puppet):
    tips = limb_tips(puppet)
    owner = puppet.weights[tips].argmax(axis=1)
    feet = [tips[owner == joint_of(puppet, leg)][0] for leg in ("leftLeg", "rightLeg")]
    place = puppet.vertices[between(puppet.vertices, puppet.faces, np.array([feet]))[0]]
    hips, floor = puppet.anchors[0], puppet.vertices[:, 1].min()
    assert abs(place[0]) < 0.05 and floor + 0.1 < place[1] < hips[1]


def test_landmarks_of_a_stylised_copy_are_paired_with_their_own(puppet, stylised):
    """The copy has the same triangles, so each pair should name nearly the same place twice."""
    surface, _ = stylised
    pairs, gap = pair_landmarks(puppet, surface, surface_tips(puppet, surface), FRONT)
    assert 0 < gap < 0.5  # measured .44
    assert len(pairs.moving) >= 6  # five tips, and where twin limbs meet
    apart = np.linalg.norm(puppet.vertices[pairs.moving] - puppet.vertices[pairs.still], axis=1)
    assert apart.max() < 0.3 and np.median(apart) < 0.1
    assert (pairs.weight == 1).all()


def test_landmarks_too_far_apart_stay_unpaired(puppet, stylised):
    surface, _ = stylised
    tips = surface_tips(puppet, surface)
    pairs, gap = pair_landmarks(puppet, surface, tips, FRONT, farthest=0.0)
    assert len(pairs.moving) == 0 and gap == 0
    np.testing.assert_array_equal(reach_tips(puppet, surface, pairs, FRONT).scales, 0)


def reached_from(puppet: Puppet, surface: Surface, heading: np.ndarray) -> Pose:
    pairs, _ = pair_landmarks(puppet, surface, surface_tips(puppet, surface), heading)
    return reach_tips(puppet, surface, pairs, heading)


def wrong(puppet: Puppet, pose: Pose, joints: np.ndarray) -> np.ndarray:
    return np.linalg.norm(pose.world(puppet)[2] - joints, axis=1)


def test_joints_of_other_proportions_are_found_from_the_tips(puppet, stylised):
    surface, joints = stylised
    reached = reached_from(puppet, surface, FRONT)
    fine = fit(puppet, reached, surface, FINE, home=reached)
    plain = fit(puppet, rest_pose(puppet), surface, FINE)
    at_rest, found = (wrong(puppet, pose, joints) for pose in (rest_pose(puppet), fine))
    assert (found < at_rest).all()
    assert at_rest.mean() > 0.04 and found.mean() < 0.022  # measured .052 and .020
    assert fit_error(puppet, fine, surface) < 0.8 * fit_error(puppet, plain, surface)  # .09, .12


def test_a_figure_faced_elsewhere_is_reached_under_its_own_heading(puppet, stylised):
    surface, _ = stylised
    turned = make_surface(surface.vertices @ QUARTERS[1].T, surface.faces)
    ahead, aside = (
        fit_error(puppet, reached_from(puppet, turned, heading), turned) for heading in QUARTERS[:2]
    )
    assert aside < 0.3 < ahead  # measured .12 and .73

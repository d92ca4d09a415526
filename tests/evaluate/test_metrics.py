import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.evaluate import metrics
from bunraku.graphs import mesh_edges
from bunraku.types import Mesh


@pytest.fixture
def poses(cube, rng):
    """Four random poses of the cube."""
    return cube.vertices + rng.normal(scale=0.1, size=(4, 8, 3))


def turned(points, angle=0.7):
    return points @ Rotation.from_rotvec([0, angle, 0]).as_matrix().T + [3.0, 0.0, 1.0]


def test_weight_error_of_one_swapped_vertex():
    """A case small enough to work out by hand: one vertex of four is wholly wrong."""
    truth = np.array([[1.0, 0.0]] * 4)
    found = truth.copy()
    found[0] = [0.0, 1.0]
    np.testing.assert_allclose(metrics.weight_error(found, truth), [25.0, 25.0])


def test_pose_distance_is_centimetres_at_one_metre(cube):
    lifted = (cube.vertices + np.array([0.0, 0.02, 0.0]))[None]
    assert metrics.pose_distance(2 * lifted, 2 * cube.vertices[None], height=2.0) == pytest.approx(
        2.0
    )
    assert metrics.pose_distance_in_place(lifted, cube.vertices[None], 1.0) < 1e-12


def test_edge_length_score_of_a_doubled_edge():
    """One triangle, one of three edges twice as long as it should be: 1 - (1 + 0 + 0) / 3."""
    faces = np.array([[0, 1, 2]])
    truth = np.array([[[0.0, 0, 0], [1.0, 0, 0], [0.5, 2.0, 0]]])
    side = np.sqrt(4.25)
    found = np.array([[[0.0, 0, 0], [2.0, 0, 0], [1.0, np.sqrt(side**2 - 1), 0]]])
    assert metrics.edge_length_score(found, truth, faces) == pytest.approx(2 / 3)


def test_edge_length_score_agrees_with_the_sum_in_the_paper(cube, poses):
    """Eq. 7 written out term by term."""
    found = poses + 0.05 * poses**2
    pairs = {tuple(sorted(pair)) for f in cube.faces for pair in zip(f, np.roll(f, 1), strict=True)}
    terms = [
        1
        - abs(
            np.linalg.norm(found[t, i] - found[t, j]) / np.linalg.norm(poses[t, i] - poses[t, j])
            - 1
        )
        for t in range(len(poses))
        for i, j in pairs
    ]
    assert metrics.edge_length_score(found, poses, cube.faces) == pytest.approx(np.mean(terms))


def test_edges_without_length_do_not_count(cube):
    faces = np.vstack([cube.faces, [[0, 8, 1]]])
    doubled = np.vstack([cube.vertices, cube.vertices[:1]])[None]
    assert metrics.edge_length_score(doubled, doubled, faces) == 1.0


def test_stretch_is_the_factor_of_a_uniform_growth(cube):
    grown, ends = 1.5 * cube.vertices[None], mesh_edges(cube.faces)
    assert metrics.stretch(grown, cube.vertices, ends) == pytest.approx(1.5)
    assert metrics.stretch(grown, cube.vertices, ends[:0]) == 1.0


def test_bone_direction_error_of_right_angles(rng):
    bones = np.tile(np.eye(3), (2, 1, 1))
    assert metrics.bone_direction_error(bones, np.roll(bones, 1, axis=1)) == pytest.approx(90.0)
    assert metrics.bone_direction_error(bones, 3 * bones) == 0.0
    assert metrics.bone_direction_error(bones, -bones) == pytest.approx(180.0)


def test_joint_error_is_per_cent_of_height():
    joints = np.zeros((2, 3))
    assert metrics.joint_error(
        joints + np.array([0.0, 0.0, 0.02]), joints, height=2.0
    ) == pytest.approx(1.0)


def test_rest_pose_error_forgives_where_the_figure_stands_and_looks(cube, rng):
    bent = cube.vertices + rng.normal(scale=0.05, size=(8, 3))
    assert metrics.rest_pose_error(turned(cube.vertices), cube.vertices, 1.0) < 1e-9
    expected = metrics.rest_pose_error(bent, cube.vertices, 1.0)
    assert metrics.rest_pose_error(turned(bent), cube.vertices, 1.0) == pytest.approx(expected)
    assert expected > 1.0


def test_twist_error_sees_only_the_turn_about_the_bone():
    axes = np.array([[1.0, 0, 0]] * 3)
    turns = Rotation.from_euler("xyz", [[30, 0, 0], [0, 40, 0], [180, 0, 0]], degrees=True)
    found = metrics.twist_error(turns.as_matrix(), np.tile(np.eye(3), (3, 1, 1)), axes)
    np.testing.assert_allclose(found, [30.0, 0.0, 180.0], atol=1e-6)


def test_a_foot_is_planted_while_low_and_slow():
    times = np.arange(5) / 10
    feet = np.zeros((5, 1, 3))
    feet[3:, 0, 1] = [0.1, 0.2]  # it lifts after the third frame
    feet[1:, 0, 0] = 0.1  # and darts forward in the first step, 1 m/s
    planted = metrics.foot_contacts(feet, times, height=1.0)
    np.testing.assert_array_equal(planted[:, 0], [False, True, False, False])
    np.testing.assert_array_equal(metrics.foot_contacts(5 * feet, times, height=5.0), planted)


def test_a_foot_that_lifts_slowly_is_planted_no_more():
    feet = np.zeros((3, 1, 3))
    feet[:, 0, 0], feet[2, 0, 1] = [0.0, 0.05, 0.1], 0.05
    for size in (1.0, 5.0):
        planted = metrics.foot_contacts(size * feet, np.array([0.0, 0.5, 1.0]), height=size)
        np.testing.assert_array_equal(planted[:, 0], [True, False])


def test_foot_slide_is_metres_per_second_of_contact():
    times = np.array([0.0, 0.5, 1.0])
    feet = np.array([[[0.0, 0, 0]], [[0.03, 0.5, 0.04]], [[9.0, 0, 0]]])
    planted = np.array([[True], [False]])
    assert metrics.foot_slide(feet, planted, times) == pytest.approx(0.1)
    assert metrics.foot_slide(feet, ~planted & False, times) == 0.0


@pytest.fixture
def two_cubes(cube) -> Mesh:
    """Two unit cubes a metre apart: the second stands in for a hand."""
    return Mesh(
        np.vstack([cube.vertices, cube.vertices + np.array([2.0, 0, 0])]),
        np.vstack([cube.faces, cube.faces + 8]),
    )


def test_penetration_counts_vertices_that_enter_the_body(two_cubes):
    posed = two_cubes.vertices.copy()
    posed[8:] = 0.2 * (posed[8:] - posed[8:].mean(axis=0)) + 0.5  # the hand shrinks into the body
    frames = np.stack([posed, two_cubes.vertices])
    shares = metrics.penetration_fractions(frames, two_cubes.vertices, two_cubes.faces)
    np.testing.assert_allclose(shares, [0.5, 0.0])


def test_penetration_at_rest_is_forgiven(two_cubes):
    overlapping = two_cubes.vertices.copy()
    overlapping[8:] -= [1.5, 0.1, 0.1]
    moved = overlapping[None] + [0.0, 1.0, 0.0]
    assert metrics.penetration_fractions(moved, overlapping, two_cubes.faces) == 0.0
    assert metrics.penetration_fractions(moved, two_cubes.vertices, two_cubes.faces) > 0.1


def test_a_point_cloud_has_no_inside(cube):
    nothing = np.zeros((0, 3), np.int64)
    assert metrics.penetration_fractions(cube.vertices[None], cube.vertices, nothing) == 0.0


LEFT_RIGHT = np.array([[1, 2]])
STANDING = np.array([[0.0, 1, 0], [0.3, 0, 0], [-0.3, 0, 0]])


def test_left_right_flip_of_joints(rng):
    noisy = STANDING + rng.normal(scale=0.05, size=STANDING.shape)
    assert not metrics.is_mirrored(noisy, STANDING, LEFT_RIGHT)
    assert metrics.is_mirrored(noisy * [-1, 1, 1], STANDING, LEFT_RIGHT)


def test_front_back_flip_is_seen_in_the_feet_alone(rng):
    """A shin leaning back slightly has no vote, however long it is."""
    bones = np.array([[0.0, -0.1, 0.2], [0.0, -0.1, 0.2], [0.0, -5.0, -1.0]])
    forward = np.array([0.0, 0.0, 1.0])
    noisy = bones + rng.normal(scale=0.02, size=bones.shape)
    assert not metrics.is_turned_back(noisy, bones, forward)
    assert not metrics.is_turned_back(noisy * [[1], [1], [-1]], bones, forward)
    assert metrics.is_turned_back(noisy * [1, 1, -1], bones, forward)
    assert not metrics.is_turned_back(noisy * [1, 1, -1], bones, -forward[[2, 0, 1]])


def test_left_right_flip_of_weights(rng):
    truth = rng.dirichlet(np.ones(3), size=20)
    assert not metrics.swaps_sides(truth, truth, LEFT_RIGHT)
    assert metrics.swaps_sides(truth[:, [0, 2, 1]], truth, LEFT_RIGHT)

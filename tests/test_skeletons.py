import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku import skeletons
from bunraku.meshes import vertex_areas
from bunraku.skeletons import (
    carry_joints,
    fit_similarities,
    joint_support,
    nearest_moving_joint,
    region_weights,
    regress_joints,
    turn_trust,
)
from bunraku.types import Character
from tests.creatures import JOINTS, NAMES, PARENTS, move, pose_of, world_pose

TURN = Rotation.from_rotvec([0.4, -1.1, 0.6]).as_matrix()
ANGLES = {"head": (0.0, 40.0, 0.0), "leftArm": (0.0, 0.0, 60.0), "leftLeg": (-45.0, 0.0, 0.0)}


def surface_of(creature: Character) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    vertices = creature.mesh.vertices
    return vertices, vertex_areas(vertices, creature.mesh.faces), creature.skin.weights


def with_idle_joint(creature: Character, joint: np.ndarray, *, first: bool) -> tuple:
    """Add a joint that moves no surface: a floor root above all, or a tip on the head."""
    vertices, areas, weights = surface_of(creature)
    place = 0 if first else len(NAMES)
    parents = np.append(-1, PARENTS + 1) if first else np.append(PARENTS, NAMES.index("head"))
    weights = np.insert(weights, place, 0.0, axis=1)
    return (vertices, areas, weights), np.insert(JOINTS, place, joint, axis=0), parents


def test_support_by_hand():
    weights = np.array([[0.6, 0.4, 0], [0.5, 0.2, 0.3], [0, 0.95, 0.05]])
    support = joint_support(weights, np.array([-1, 0, 1]))
    expected = [[True, True, False], [False, True, True], [False, False, False]]
    np.testing.assert_array_equal(support, expected)


def test_region_weights_by_hand():
    weights = np.array([[0.6, 0.4]])
    regions = region_weights(np.array([2.0]), weights, np.array([-1, 0]))
    np.testing.assert_allclose(regions, [[2 * 0.6 * 0.6 * 1.02, 2 * 0.4 * (0.6 + 0.02 * 0.4)]])


def test_similarities_agree_with_a_known_one_and_with_a_loop(rng):
    vertices = rng.normal(size=(40, 3))
    images = 1.7 * vertices @ TURN.T + [1.0, 2.0, 3.0]
    regions = rng.random((40, 3))
    rotations, scales, centres, image_centres = fit_similarities(vertices, images, regions)
    np.testing.assert_allclose(rotations, np.tile(TURN, (3, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(scales, 1.7)
    for joint in range(3):
        share = regions[:, joint] / regions[:, joint].sum()
        np.testing.assert_allclose(centres[joint], sum(share[:, None] * vertices))
        np.testing.assert_allclose(image_centres[joint], sum(share[:, None] * images))


def test_similarities_leave_no_smaller_error_nearby(rng):
    """Of a noisy image: any small change of turn or scale fits worse."""
    vertices, region = rng.normal(size=(40, 3)), rng.random((40, 1))
    images = vertices @ TURN.T + rng.normal(scale=0.3, size=(40, 3))
    rotations, scales, centres, image_centres = fit_similarities(vertices, images, region)

    def error(rotation: np.ndarray, scale: float) -> float:
        fitted = scale * (vertices - centres[0]) @ rotation.T + image_centres[0]
        return float(region[:, 0] @ ((fitted - images) ** 2).sum(axis=1))

    best = error(rotations[0], scales[0])
    for change in 0.02 * np.vstack([np.eye(3), -np.eye(3)]):
        assert error(Rotation.from_rotvec(change).as_matrix() @ rotations[0], scales[0]) > best
    assert min(error(rotations[0], scales[0] + step) for step in (-0.01, 0.01)) > best


def test_a_region_without_weight_stays_as_it_is(rng):
    vertices = rng.normal(size=(40, 3))
    rotations, scales, _, _ = fit_similarities(vertices, vertices @ TURN.T, np.zeros((40, 1)))
    np.testing.assert_array_equal(rotations[0], np.eye(3))
    assert scales[0] == 1.0


def test_regressed_joints_are_exact_under_any_affine_map(creature, rng):
    vertices, areas, weights = surface_of(creature)
    linear = np.eye(3) + 0.2 * rng.normal(size=(3, 3))
    support = joint_support(weights, PARENTS)
    images = vertices @ linear.T + [1.0, 0.0, 2.0]
    placed, known = regress_joints(vertices, areas, support, JOINTS, images)
    assert known.all()
    np.testing.assert_allclose(placed, JOINTS @ linear.T + [1.0, 0.0, 2.0], atol=1e-5)


def test_a_joint_with_few_vertices_around_it_is_not_regressed(creature):
    vertices, areas, weights = surface_of(creature)
    support = joint_support(weights, PARENTS)
    support[np.flatnonzero(support[:, 2])[5:], 2] = False
    placed, known = regress_joints(vertices, areas, support, JOINTS, vertices)
    np.testing.assert_array_equal(known, np.arange(7) != 2)
    assert np.isnan(placed[2]).all() and np.isfinite(placed[known]).all()


def test_joints_are_carried_exactly_by_a_similarity(creature):
    images = 0.6 * creature.mesh.vertices @ TURN.T + [1.0, 2.0, 3.0]
    placed = carry_joints(*surface_of(creature), JOINTS, PARENTS, images)
    np.testing.assert_allclose(placed, 0.6 * JOINTS @ TURN.T + [1.0, 2.0, 3.0], atol=1e-5)


def test_joints_are_carried_to_where_a_pose_takes_them(creature):
    world = world_pose(creature.skeleton, pose_of(ANGLES))
    placed = carry_joints(*surface_of(creature), JOINTS, PARENTS, move(creature, world))
    wrong = np.linalg.norm(placed - world[:, :3, 3], axis=1)
    assert wrong.max() < 0.015  # of 1.1 m


@pytest.mark.parametrize("first", [True, False])
def test_a_joint_that_moves_nothing_keeps_its_place_beside_the_others(creature, first):
    joint = np.array([0.1, -0.02, 0.05]) if first else JOINTS[2] + [0.0, 0.3, 0.1]
    surface, joints, parents = with_idle_joint(creature, joint, first=first)
    images = 2.0 * surface[0] @ TURN.T
    placed = carry_joints(*surface, joints, parents, images)
    np.testing.assert_allclose(placed, 2.0 * joints @ TURN.T, atol=1e-4)


def test_a_regressor_that_ran_away_is_not_believed(creature, monkeypatch):
    def run_away(vertices, areas, support, joints, images):
        return joints + np.array([0.0, 0.0, 9.0]), np.ones(len(joints), bool)

    monkeypatch.setattr(skeletons, "regress_joints", run_away)
    surface = surface_of(creature)
    placed = carry_joints(*surface, JOINTS, PARENTS, surface[0])
    np.testing.assert_allclose(placed, JOINTS, atol=1e-6)


def test_the_nearest_moving_joint_by_hand():
    """A floor root goes with the first that moves; a chain of tips with the last that does."""
    moves = np.array([False, True, True, False, False])
    carrier = nearest_moving_joint(moves, np.array([-1, 0, 1, 2, 3]), np.zeros((5, 3)))
    np.testing.assert_array_equal(carrier, [1, 1, 2, 2, 2])


def test_a_control_beside_the_body_goes_with_the_joint_nearest_in_space():
    """A still root with hips, a hand and, on its own branch, the hand's control; a stray root."""
    moves = np.array([False, True, True, False, False, False])
    places = np.array(
        [[0.0, 0, 0], [0, 1, 0], [0.7, 1.4, 0], [0.8, 1.4, 0], [0.9, 1, 0], [0, 0, 3]]
    )
    carrier = nearest_moving_joint(moves, np.array([-1, 0, 1, 0, 3, -1]), places)
    np.testing.assert_array_equal(carrier, [1, 1, 2, 2, 2, 1])


def test_when_nothing_moves_the_first_joint_carries_all():
    carrier = nearest_moving_joint(np.zeros(3, bool), np.array([-1, 0, 1]), np.eye(3))
    np.testing.assert_array_equal(carrier, 0)


def test_a_joint_without_surface_is_not_trusted(creature):
    (_, areas, weights), _, _ = with_idle_joint(creature, JOINTS[2], first=False)
    trust = turn_trust(areas, weights)
    np.testing.assert_array_equal(trust, [1] * 7 + [0])
    weights[:, 0] *= 0.005 * areas.sum() / (areas @ weights[:, 0])
    assert np.isclose(turn_trust(areas, weights)[0], 0.5)

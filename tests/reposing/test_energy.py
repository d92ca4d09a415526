import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.graphs import descendants
from bunraku.reposing.energy import (
    add_turn_costs,
    goal_joints,
    linearise_joints,
    local_turns,
    place_joints,
    recover_rest_pose,
)
from bunraku.rotations import matrices_to_vectors, rotation_angles, vectors_to_matrices
from tests.creatures import JOINTS, PARENTS

STILL = np.zeros(3)
CHAIN = np.array([-1, 0, 1])
LIMBS = np.array([-1, 0, 1, 2, 1, 4, 0, 6, 0, 8])  # hips, neck, arms of two bones, legs of two
LIMB_JOINTS = np.array(
    [
        *([0.0, 1.0, 0.0], [0, 1.5, 0]),
        *([0.4, 1.4, 0.0], [0.8, 1.3, 0.1], [-0.4, 1.4, 0], [-0.8, 1.3, 0.1]),
        *([0.1, 0.5, 0.0], [0.1, 0.1, 0.1], [-0.1, 0.5, 0], [-0.1, 0.1, 0.1]),
    ]
)


def turn(axis: str, degrees: float) -> np.ndarray:
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def degrees(turns: np.ndarray) -> np.ndarray:
    return np.rad2deg(rotation_angles(turns))


def random_turns(rng: np.random.Generator, count: int, size: float = 0.5) -> np.ndarray:
    return vectors_to_matrices(rng.normal(scale=size, size=(count, 3)))


def test_the_goal_has_the_sources_directions_and_the_figures_lengths():
    joints = np.array([[5.0, 0, 0], [5, 0, 2], [5, 0, 5]])
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    np.testing.assert_allclose(goal_joints(joints, rest, CHAIN), [[5, 0, 0], [7, 0, 0], [7, 3, 0]])


def test_a_bone_without_length_stays_without():
    rest = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    goal = goal_joints(np.array([[0.0, 0, 0], [0, 0, 0], [0, 2, 0]]), rest, CHAIN)
    np.testing.assert_allclose(goal, [[0, 0, 0], [0, 0, 0], [2, 0, 0]])


@pytest.mark.parametrize("length", [0.0, 1e-9])
def test_a_bone_without_direction_in_the_source_keeps_the_figures(length):
    rest = np.array([[0.0, 0, 0], [0, 0, length], [1, 0, 0]])
    goal = goal_joints(np.array([[0.0, 0, 0], [0, 3, 0], [0, 5, 0]]), rest, CHAIN)
    np.testing.assert_allclose(goal, [[0, 0, 0], [0, 3, 0], [2, 3, 0]], atol=1e-8)


def test_a_skeleton_of_one_joint_is_turned_as_its_surface_is():
    found = turn("y", 40)[None]
    one, far = np.array([-1]), np.array([[3.0, -4.0, 5.0]])
    turns = recover_rest_pose(far, far + 2, one, surface_turns=found, trust=np.ones(1))
    np.testing.assert_allclose(turns[0], found[0].T, atol=1e-6)


def test_places_after_a_quarter_turn_of_the_elbow():
    joints = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]])
    turns = np.stack([np.eye(3), turn("z", 90), np.eye(3)])
    placed, world = place_joints(joints, CHAIN, turns, np.array([0.0, 0, 4]))
    np.testing.assert_allclose(placed, [[0, 0, 4], [1, 0, 4], [1, 1, 4]], atol=1e-12)
    np.testing.assert_allclose(world, [np.eye(3), turn("z", 90), turn("z", 90)], atol=1e-12)


def test_local_and_world_turns_undo_each_other(rng):
    turns = random_turns(rng, 7)
    _, world = place_joints(JOINTS, PARENTS, turns, STILL)
    np.testing.assert_allclose(local_turns(world, PARENTS), turns, atol=1e-12)


def test_places_do_not_depend_on_the_order_of_storage(rng):
    turns, order = random_turns(rng, 7), rng.permutation(7)
    parents = np.full(7, -1)
    place = np.argsort(order)
    parents[place[1:]] = place[PARENTS[1:]]
    placed, world = place_joints(JOINTS, PARENTS, turns, STILL)
    shuffled, shuffled_world = place_joints(JOINTS[order], parents, turns[order], STILL)
    np.testing.assert_allclose(shuffled, placed[order], atol=1e-12)
    np.testing.assert_allclose(shuffled_world, world[order], atol=1e-12)


def test_the_linear_model_agrees_with_finite_differences(rng):
    """Normal equations J^T J and J^T r of Eq. 11, from places differentiated one by one."""
    turns, goal, count = random_turns(rng, 7), rng.normal(size=(7, 3)), 7
    placed, world = place_joints(JOINTS, PARENTS, turns, STILL)
    above = np.concatenate([np.eye(3)[None], world])[PARENTS + 1]

    def moved(step: np.ndarray) -> np.ndarray:
        change = vectors_to_matrices(step[:-3].reshape(-1, 3))
        stepped = np.swapaxes(above, 1, 2) @ change @ above @ turns
        return place_joints(JOINTS, PARENTS, stepped, step[-3:])[0].ravel()

    jacobian = np.stack(
        [(moved(e) - moved(-e)) / 2e-6 for e in 1e-6 * np.eye(3 * count + 3)], axis=1
    )
    hessian, gradient = linearise_joints(placed, goal, descendants(PARENTS))
    np.testing.assert_allclose(hessian, jacobian.T @ jacobian / count, atol=1e-8)
    residual = (goal - placed).ravel()
    np.testing.assert_allclose(gradient, jacobian.T @ residual / count, atol=1e-8)


def test_turn_costs_agree_with_finite_differences(rng):
    """sum of trust |turn left|^2: a joint's turn is that of every joint above it as well."""
    count, trust = 7, rng.random(7)
    seen = random_turns(rng, 7, 0.01)
    turns = random_turns(rng, 7)
    _, world = place_joints(JOINTS, PARENTS, turns, STILL)
    surfaces = np.swapaxes(world, 1, 2) @ seen  # so that little is left to turn
    above = np.concatenate([np.eye(3)[None], world])[PARENTS + 1]

    def left(step: np.ndarray) -> np.ndarray:
        change = vectors_to_matrices(step.reshape(-1, 3))
        stepped = np.swapaxes(above, 1, 2) @ change @ above @ turns
        _, turned = place_joints(JOINTS, PARENTS, stepped, STILL)
        return matrices_to_vectors(turned @ surfaces)

    unseen = left(np.zeros(3 * count))
    hessian, gradient = np.zeros((3 * count + 3,) * 2), np.zeros(3 * count + 3)
    add_turn_costs(hessian, gradient, below=descendants(PARENTS), unseen=unseen, trust=trust)
    jacobian = np.stack(
        [(left(e) - left(-e)).ravel() / 2e-5 for e in 1e-5 * np.eye(3 * count)], axis=1
    )
    weighted = np.repeat(trust, 3)[:, None] * jacobian
    # exact where nothing is left to turn: here to the size of what is left
    np.testing.assert_allclose(hessian[:-3, :-3], jacobian.T @ weighted / count, atol=0.02)
    np.testing.assert_allclose(gradient[:-3], -weighted.T @ unseen.ravel() / count, atol=1e-4)


def test_a_figure_already_at_rest_is_left_alone():
    turns = recover_rest_pose(JOINTS, JOINTS, PARENTS)
    assert degrees(turns).max() < 1e-4


def test_a_posed_skeleton_returns_to_rest(rng):
    posed, _ = place_joints(LIMB_JOINTS, LIMBS, random_turns(rng, 10, 0.4), np.array([1.0, 2, 3]))
    turns = recover_rest_pose(posed, LIMB_JOINTS, LIMBS)
    back, _ = place_joints(posed, LIMBS, local_turns(turns, LIMBS), LIMB_JOINTS[0] - posed[0])
    assert np.linalg.norm(back - LIMB_JOINTS, axis=1).max() < 0.02  # of 1.6 m


def test_bones_keep_the_figures_lengths(rng):
    """A figure of other proportions, found in another pose, ends in the source's directions."""
    scaled = goal_joints(LIMB_JOINTS * [1.5, 0.7, 1.2], LIMB_JOINTS, LIMBS)
    posed, _ = place_joints(scaled, LIMBS, random_turns(rng, 10, 0.4), STILL)
    turns = recover_rest_pose(posed, LIMB_JOINTS, LIMBS)
    back, _ = place_joints(posed, LIMBS, local_turns(turns, LIMBS), scaled[0] - posed[0])
    assert np.linalg.norm(back - scaled, axis=1).max() < 0.03


def test_a_figure_turned_round_comes_back(rng):
    for heading in (90, 179):
        posed = LIMB_JOINTS @ turn("y", heading).T
        turns = recover_rest_pose(posed, LIMB_JOINTS, LIMBS)
        wrong = degrees(turns @ turn("y", heading))
        assert wrong.max() < 5


@pytest.fixture
def twisted() -> tuple[np.ndarray, np.ndarray]:
    """An upper arm turned 60 degrees about itself, its straight forearm with it; and its joints."""
    rest = LIMB_JOINTS.copy()
    rest[3] = rest[2] + (rest[2] - rest[1])
    axis = (rest[3] - rest[2]) / np.linalg.norm(rest[3] - rest[2])
    turns = np.tile(np.eye(3), (10, 1, 1))
    turns[2:4] = Rotation.from_rotvec(np.deg2rad(60) * axis).as_matrix()
    return rest, turns


def test_twist_that_joints_do_not_show_is_read_off_the_surface(twisted):
    rest, surface = twisted
    turns = recover_rest_pose(rest, rest, LIMBS, surface_turns=surface, trust=np.ones(10))
    assert degrees(turns @ surface).max() < 5


def test_without_a_surface_that_twist_stays(twisted):
    rest, surface = twisted
    for found in (
        recover_rest_pose(rest, rest, LIMBS),
        recover_rest_pose(rest, rest, LIMBS, surface_turns=surface),
    ):
        placed, _ = place_joints(rest, LIMBS, local_turns(found, LIMBS), STILL)
        assert np.abs(placed - rest).max() < 0.02  # the joints agree whatever the twist
    assert degrees(recover_rest_pose(rest, rest, LIMBS) @ surface)[2] > 55


@pytest.mark.parametrize("lone", [True, False])
@pytest.mark.parametrize("heading", [90.0, 180.0])
def test_the_heading_is_found_behind_a_joint_that_moves_nothing(lone, heading):
    """Stored first: a floor root above the hips, or an exporter's lone bone."""
    parents = np.append(-1, np.where(lone & (PARENTS < 0), -1, PARENTS + 1))
    rest = np.vstack([[0.0, 0.0, 0.0], JOINTS])
    surface = np.tile(turn("y", heading), (8, 1, 1))
    surface[0] = np.eye(3)  # as surface_turns gives where there is no surface
    trust = np.append(0.0, np.ones(7))
    joints = rest @ turn("y", heading).T
    found = recover_rest_pose(joints, rest, parents, surface_turns=surface, trust=trust)
    assert degrees(found @ surface)[1:].max() < 3


def test_a_skeleton_of_one_joint_turns_as_its_surface():
    surface = turn("y", 70)[None]
    found = recover_rest_pose(
        np.ones((1, 3)), np.zeros((1, 3)), np.array([-1]), surface_turns=surface, trust=np.ones(1)
    )
    assert degrees(found @ surface).max() < 1e-3

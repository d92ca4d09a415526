import numpy as np
import pytest

from bunraku.contacts import Performed, plant_feet
from bunraku.contacts.finding import Contacts
from bunraku.contacts.planting import bending_cost, bound, is_loop, solve_corrections
from bunraku.rotations import compose_transforms, rotation_angles, vectors_to_matrices
from tests.contacts.walkers import JOINTS, PARENTS, legs_of

TIMES = np.arange(61) / 30.0
BODY = np.zeros(3)


def pose(joints: np.ndarray, swings: np.ndarray, hips: np.ndarray) -> np.ndarray:
    """Swing thighs and shanks about X; feet keep their turn. Gives world_from_joint."""
    turns = np.tile(np.eye(3), (len(swings), 9, 1, 1))
    for column, joint in enumerate((1, 2, 5, 6)):
        turns[:, joint] = vectors_to_matrices(swings[:, column, None] * [1.0, 0, 0])
    places = np.zeros((len(swings), 9, 3))
    places[:, 0] = joints[0] + hips
    for joint in range(1, 9):
        parent = PARENTS[joint]
        offset = joints[joint] - joints[parent]
        places[:, joint] = places[:, parent] + turns[:, parent] @ offset
    return compose_transforms(places, turns)


def crouching() -> tuple[np.ndarray, np.ndarray]:
    """Bend both knees and lower the hips so that the walker's own feet stay where they are."""
    depth = 0.6 * np.sin(np.pi * TIMES / 2) ** 2
    swings = np.stack([-depth, 0.9 * depth] * 2, axis=1)
    free = pose(JOINTS, swings, np.zeros((61, 3)))
    return swings, JOINTS[3] - free[:, 3, :3, 3]


@pytest.fixture
def other() -> np.ndarray:
    """A walker with long thighs and short shanks."""
    joints = JOINTS.copy()
    joints[[2, 6], 1] -= 0.08
    return joints


@pytest.fixture
def crouch() -> Performed:
    frames = pose(JOINTS, *crouching())
    return Performed(frames[..., :3, 3], JOINTS, TIMES, 1.0)


def bones(frames: np.ndarray) -> np.ndarray:
    places = frames[..., :3, 3]
    return np.linalg.norm(places[:, 1:] - places[:, PARENTS[1:]], axis=2)


def test_feet_that_the_copied_turns_move_stay(other, crouch):
    swings, hips = crouching()
    copied = pose(other, swings, hips)
    assert np.ptp(copied[:, 3, :3, 3], axis=0).max() > 0.02
    planted = plant_feet(copied, other, legs_of(), crouch, scale=1.0)
    for foot in (3, 4, 7, 8):
        assert np.ptp(planted[:, foot, :3, 3], axis=0).max() < 1e-3
    np.testing.assert_allclose(
        planted[:, [3, 4, 7, 8], 1, 3], other[[3, 4, 7, 8], 1] + np.zeros((61, 4)), atol=1e-3
    )
    np.testing.assert_allclose(
        bones(planted)[:, [1, 2, 3, 5, 6, 7]], bones(copied)[:, [1, 2, 3, 5, 6, 7]], atol=1e-9
    )
    np.testing.assert_allclose(
        planted[:, [0, 3, 4], :3, :3], copied[:, [0, 3, 4], :3, :3], atol=1e-9
    )


def test_no_joint_turns_much_faster_than_before(other, crouch):
    copied = pose(other, *crouching())
    planted = plant_feet(copied, other, legs_of(), crouch, scale=1.0)
    before, after = (
        rotation_angles(
            np.swapaxes(f[:-1, [1, 2, 5, 6], :3, :3], 2, 3) @ f[1:, [1, 2, 5, 6], :3, :3]
        )
        for f in (copied, planted)
    )
    assert after.max() < 1.6 * before.max()


def test_the_source_on_itself_is_left_alone(crouch):
    copied = pose(JOINTS, *crouching())
    planted = plant_feet(copied, JOINTS, legs_of(), crouch, scale=1.0)
    np.testing.assert_allclose(planted, copied, atol=1e-6)


def test_a_body_in_the_air_is_left_alone(other, crouch):
    copied = pose(other, *crouching())
    flying = Performed(crouch.paths + np.array([0.0, 0.5, 0.0]), JOINTS, TIMES, 1.0)
    assert plant_feet(copied, other, legs_of(), flying, scale=1.0) is copied


def test_a_body_that_stands_on_nothing_is_left_alone(other, crouch):
    copied = pose(other, *crouching())
    assert plant_feet(copied, other, (), crouch, scale=1.0) is copied


def test_a_leg_without_length_is_left_alone(other, crouch):
    """As where a figure has no legs, and all joints of one lie in one place."""
    flat = other.copy()
    flat[[2, 3]] = flat[1]
    copied = pose(flat, *crouching())
    planted = plant_feet(copied, flat, legs_of(), crouch, scale=1.0)
    assert np.isfinite(planted).all()
    np.testing.assert_allclose(planted[:, 2, :3, :3], copied[:, 2, :3, :3])
    assert np.ptp(planted[:, 7, :3, 3], axis=0).max() < 1e-3


def test_feet_on_a_treadmill_glide_at_the_figures_scale(other):
    still = np.zeros((61, 4))
    carried = -0.4 * TIMES[:, None] * [0.0, 0.0, 1.0]
    source = Performed(pose(JOINTS, still, carried)[..., :3, 3], JOINTS, TIMES, 1.0)
    shaken = pose(
        2 * other, still, 2 * carried + 0.02 * np.sin(3 * np.pi * TIMES)[:, None] * [0, 0, 1.0]
    )
    planted = plant_feet(shaken, 2 * other, legs_of(), source, scale=2.0)
    speed = np.diff(planted[:, 3, 2, 3]) * 30
    np.testing.assert_allclose(speed, -0.8, atol=0.02)


def anchored(count: int) -> Contacts:
    """Plant one sole in the first and the last frames of `count`, as two contacts."""
    numbers = np.zeros((count, 1), np.int64)
    numbers[: count // 3], numbers[-(count // 3) :] = 1, 2
    return Contacts(numbers, np.ones((count, 1)))


def test_a_constant_miss_along_the_ground_is_no_miss():
    missing = np.tile([0.3, 0.05, -0.2], (61, 1, 1))
    shift = solve_corrections(missing, anchored(61), TIMES, loops=False)
    np.testing.assert_allclose(shift[:, [0, 2]], 0, atol=1e-6)
    np.testing.assert_allclose(shift[[5, -5], 1], 0.05, atol=1e-3)


def test_corrections_agree_with_a_plain_least_squares(rng):
    missing = rng.normal(size=(12, 1, 3)).cumsum(axis=0)
    times, contacts = TIMES[:12], anchored(12)
    widths = np.gradient(times)
    rows, goal = [], []
    for frame in np.flatnonzero(contacts.numbers[:, 0]):
        row = np.zeros(14)
        row[[frame, 11 + contacts.numbers[frame, 0]]] = 1.0, -1.0
        rows.append(np.sqrt(widths[frame]) * row)
        goal.append(np.sqrt(widths[frame]) * missing[frame, 0, 0])
    cost = 1e-4 * (np.diag(widths) + bending_cost(times, loops=False).toarray())
    whole = np.array(rows).T @ np.array(rows)
    whole[:12, :12] += cost
    expected = np.linalg.solve(whole, np.array(rows).T @ np.array(goal))[:12]
    found = solve_corrections(missing, contacts, times, loops=False)
    np.testing.assert_allclose(found[:, 0], expected, atol=1e-8)


def test_a_straight_line_costs_no_bending(rng):
    times = np.cumsum(rng.uniform(0.01, 0.05, 20))
    line = 3.0 - 2.0 * times
    assert line @ bending_cost(times, loops=False) @ line == pytest.approx(0.0, abs=1e-12)
    wave = np.sin(times * 9)
    assert wave @ bending_cost(times, loops=False) @ wave > 1e-3


def test_a_loops_ends_are_tied():
    missing = np.linspace(0, 1, 61)[:, None, None] * np.ones(3)
    for loops in (False, True):
        shift = solve_corrections(missing, anchored(61), TIMES, loops=loops)
        assert (np.abs(shift[0] - shift[-1]).max() < 1e-2) == loops


def test_a_clip_loops_if_it_ends_as_it_began_wherever_it_went():
    path = np.tile(JOINTS, (5, 1, 1))
    path[:, :, 2] += np.arange(5.0)[:, None]
    path[2, 3] += 0.2
    assert is_loop(path, 1.0)
    path[-1, 3] += 0.05
    assert not is_loop(path, 1.0)


def test_corrections_are_bounded():
    shift = np.array([[0.0, 0.1, 0.0], [3.0, 4.0, 0.0]])
    np.testing.assert_allclose(bound(shift, 1.0), [[0, 0.1, 0], [0.6, 0.8, 0]])

import numpy as np
import pytest

from bunraku.contacts.finding import find_contacts, ground_velocity, runs_with

TIMES = np.arange(31) / 30.0


def steps_of(heights: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Give one sole's path over the ground."""
    return np.stack([np.zeros(31), heights, ahead], axis=1)[:, None]


def walking(speed: float = 0.0) -> np.ndarray:
    """Stand for a third, swing over half a metre, stand again; carried along if need be."""
    swing = np.clip((TIMES - 0.34) / 0.32, 0, 1)
    ahead = 0.5 * (1 - np.cos(np.pi * swing)) / 2 + speed * TIMES
    return steps_of(0.1 * np.sin(np.pi * swing) ** 2, ahead)


def test_a_step_by_hand():
    found = find_contacts(walking(), np.zeros(1), TIMES, 1.0)
    numbers = found.numbers[:, 0]
    assert (numbers[:9] == numbers[0]).all() and numbers[0] > 0
    assert (numbers[13:18] == 0).all()
    assert (numbers[-9:] == numbers[-1]).all() and numbers[-1] not in (0, numbers[0])
    assert found.stillness[4, 0] == pytest.approx(1.0)
    np.testing.assert_array_equal(found.touching, numbers > 0)


def test_size_does_not_matter():
    one = find_contacts(walking(), np.zeros(1), TIMES, 1.0)
    other = find_contacts(170 * walking(), np.zeros(1), TIMES, 170.0)
    np.testing.assert_array_equal(one.numbers > 0, other.numbers > 0)


def test_feet_on_a_treadmill_are_planted_though_they_move():
    """A walk on the spot: the two feet take turns at gliding backwards."""
    phase = np.stack([TIMES % 1.0, (TIMES + 0.5) % 1.0], axis=1)
    back = np.where(phase < 0.6, 0.6 - 1.5 * phase, -0.3 + 0.9 * (phase - 0.6) / 0.4)
    lift = np.where(phase < 0.6, 0.0, 0.1 * np.sin(np.pi * (phase - 0.6) / 0.4))
    soles = np.stack([np.zeros_like(back), lift, back], axis=2)
    found = find_contacts(soles, np.zeros(2), TIMES, 1.0)
    planted = (phase[:-1] < 0.55) & (phase[1:] < 0.55)
    assert (found.numbers[:-1] > 0)[planted].all()
    assert not found.numbers[phase > 0.75].any()


def test_hysteresis_outlasts_a_tremble():
    heights = np.full(31, 0.01)
    heights[13:16] = [0.025, 0.03, 0.025]  # above where contacts begin, below where they end
    assert (
        len(np.unique(find_contacts(steps_of(heights, 0 * TIMES), np.zeros(1), TIMES, 1.0).numbers))
        == 1
    )
    heights[14:16] = 0.08
    found = find_contacts(steps_of(heights, 0 * TIMES), np.zeros(1), TIMES, 1.0).numbers
    assert not found[14:16].any() and found[0] != found[-1]


def test_what_hangs_in_the_air_stands_on_nothing():
    still = steps_of(np.full(31, 0.5), 0 * TIMES)
    assert not find_contacts(still, np.zeros(1), TIMES, 1.0).numbers.any()


def test_a_leg_that_bears_nothing_is_not_planted():
    still = steps_of(np.zeros(31), 0 * TIMES)
    bearing = TIMES < 0.5
    found = find_contacts(still, np.zeros(1), TIMES, 1.0, bearing=bearing).numbers[:, 0]
    np.testing.assert_array_equal(found > 0, bearing)


def test_two_frames_are_too_few_to_tell():
    assert not find_contacts(np.zeros((2, 1, 3)), np.zeros(1), TIMES[:2], 1.0).numbers.any()


def test_the_ground_stands_still_unless_low_feet_move_as_one(rng):
    low = np.ones((20, 2), bool)
    carried = np.tile([0.0, 0.0, -1.0], (20, 2, 1))
    np.testing.assert_allclose(ground_velocity(carried, low), [0, 0, -1])
    carried[:8] = 0.0
    np.testing.assert_allclose(ground_velocity(carried, low), 0)
    np.testing.assert_allclose(ground_velocity(rng.normal(scale=5, size=(20, 2, 3)), low), 0)
    np.testing.assert_allclose(ground_velocity(carried, ~low), 0)


def test_runs_are_kept_if_they_begin_somewhere():
    lasts = np.array([[1, 1, 0, 1, 1, 0, 1], [0, 1, 1, 0, 0, 1, 1]], bool).T
    begins = np.array([[0, 1, 0, 0, 0, 0, 1], [0, 1, 0, 0, 0, 0, 0]], bool).T
    found = runs_with(lasts, begins)
    expected = [[1, 1, 0, 0, 0, 0, 1], [0, 1, 1, 0, 0, 0, 0]]
    np.testing.assert_array_equal(found > 0, np.array(expected, bool).T)
    assert len(np.unique(found)) == 4  # three runs of their own, and none

import numpy as np
import pytest

from bunraku.contacts.limbs import bend_limb, bending_axes, soft_reach
from bunraku.rotations import vectors_to_matrices

AHEAD = np.array([[0.0, 0.0, 1.0]])
TURNS = np.eye(3)[None]


def limb(*angles: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hang limbs of two parts of length one from the origin, knees bent forwards."""
    half = np.array(angles) / 2
    knee = np.stack([0 * half, -np.cos(half), np.sin(half)], axis=1)
    return np.zeros_like(knee), knee, knee * [1.0, 2.0, 0.0]


def solve(hip, knee, foot, goal) -> tuple[np.ndarray, np.ndarray]:
    """Give knee and foot of a limb bent towards its goal."""
    turns, ahead = np.tile(np.eye(3), (len(hip), 1, 1)), np.tile(AHEAD, (len(hip), 1))
    upper, lower = bend_limb(hip, knee, foot, goal, bending_axes(hip, knee, foot, turns, ahead))
    bent = hip + np.einsum("fab,fb->fa", upper, knee - hip)
    return bent, bent + np.einsum("fab,fb->fa", lower, foot - knee)


def test_a_right_angle_by_hand():
    """A goal at the root of two makes a right angle at the knee, which points ahead."""
    bent, foot = solve(*limb(0.4), np.array([[0.0, -np.sqrt(2), 0.0]]))
    np.testing.assert_allclose(foot, [[0, -np.sqrt(2), 0]], atol=1e-9)
    np.testing.assert_allclose(bent, [[0, -np.sqrt(0.5), np.sqrt(0.5)]], atol=1e-9)


def test_any_goal_within_reach_is_met_with_bones_as_long_as_before(rng):
    place = rng.normal(size=3)
    hip, knee, foot = (points + place for points in limb(*np.linspace(0.3, 2, 50)))
    away = rng.normal(size=(50, 3))
    away *= rng.uniform(0.4, 1.6, (50, 1)) / np.linalg.norm(away, axis=1, keepdims=True)
    bent, met = solve(hip, knee, foot, hip + away)
    np.testing.assert_allclose(met, hip + away, atol=1e-9)
    for now, before in ((bent - hip, knee - hip), (met - bent, foot - knee)):
        np.testing.assert_allclose(np.linalg.norm(now, axis=1), np.linalg.norm(before, axis=1))


def test_a_goal_at_the_foot_changes_nothing(rng):
    hip, knee, foot = limb(0.2, 0.9, 2.0)
    bent, met = solve(hip, knee, foot, foot)
    np.testing.assert_allclose(bent, knee, atol=1e-9)
    np.testing.assert_allclose(met, foot, atol=1e-9)


def test_the_knee_stays_in_its_plane():
    hip, knee, foot = limb(0.8)
    bent, _ = solve(hip, knee, foot, np.array([[0.0, -1.2, 0.3]]))
    assert bent[0, 0] == pytest.approx(0.0, abs=1e-12) and bent[0, 2] > 0.3


def test_a_straight_leg_bends_the_way_it_does_in_other_frames():
    """Sideways in the third frame, so in the others: it is not taken to bend ahead."""
    hip, knee, foot = limb(0.0, 0.0, 0.0)
    knee[2] = [np.sin(0.4), -np.cos(0.4), 0.0]
    foot[2] = [0.0, -2 * np.cos(0.4), 0.0]
    bent, _ = solve(hip, knee, foot, foot * 0.9)
    assert (bent[:, 0] > 0.3).all()
    np.testing.assert_allclose(bent[:, 2], 0, atol=1e-9)


def test_a_leg_that_never_bends_bends_ahead():
    hip, knee, foot = limb(0.0, 0.0)
    bent, _ = solve(hip, knee, foot, foot * 0.8)
    assert (bent[:, 2] > 0.3).all()


def test_what_is_out_of_reach_is_approached_without_a_snap():
    far = np.linspace(1.9, 3.0, 200)
    hip, knee, foot = limb(*np.full(200, 2 * np.arccos(0.95)))
    bent, met = solve(hip, knee, foot, -np.stack([0 * far, far, 0 * far], axis=1))
    reached = -met[:, 1]
    assert (np.diff(reached) > -1e-12).all() and reached[-1] <= 2.0
    angles = 2 * np.arccos(np.clip(-bent[:, 1], -1, 1))
    assert np.abs(np.diff(angles)).max() < 0.06  # 25 radians a unit of way: no square root


def test_slack_is_used_up_ever_more_slowly():
    own, length = np.array([0.9, 0.9, 0.9, 0.99]), np.ones(4)
    found = soft_reach(own, np.array([0.5, 0.97, 9.0, 0.995]), length)
    np.testing.assert_allclose(found, [0.5, 0.97, 0.999, 0.999 - 0.009 * np.exp(-5 / 9)])


def test_the_axis_turns_with_the_limb():
    hip, knee, foot = limb(0.7)
    turn = vectors_to_matrices(np.array([0.3, -0.4, 0.8]))
    axis = bending_axes(hip, knee, foot, TURNS, AHEAD)
    turned = bending_axes(hip, knee @ turn.T, foot @ turn.T, turn[None], AHEAD)
    np.testing.assert_allclose(turned, axis @ turn.T, atol=1e-12)


def test_a_goal_in_the_hip_folds_the_limb_as_far_as_it_goes():
    hip, knee, foot = limb(0.8, 0.0)
    bent, met = solve(hip, knee, foot, hip)
    assert np.isfinite(bent).all() and np.linalg.norm(met, axis=1).max() < 0.01

import numpy as np
import pytest

from bunraku.depth.projection import project_points
from bunraku.registration.outline import STRIDE, find_nearest_shown, find_strays

INTRINSICS = np.array([[100.0, 0, 31.5], [0, 50.0, 23.5], [0, 0, 1.0]])


@pytest.fixture(scope="module")
def nearest():
    """A subject 2 m away, in rows 16 to 31 and columns 20 to 39."""
    depth = np.zeros((48, 64))
    depth[16:32, 20:40] = 2.0
    return find_nearest_shown(depth)


def point(row: float, column: float, away: float) -> np.ndarray:
    """Give the point that a pixel shows."""
    return away * np.array([(column - 31.5) / 100, -(row - 23.5) / 50, -1.0])


def test_what_sticks_out_goes_back_to_the_outline_at_its_own_depth(nearest):
    beside, below = point(24, 50, 3.0), point(42, 30, 1.0)
    stray, ways = find_strays(np.array([beside, below]), nearest, INTRINSICS)
    np.testing.assert_array_equal(stray, [0, 1])
    np.testing.assert_array_equal(ways[:, 2], 0.0)
    back = project_points(np.array([beside, below]) + ways, INTRINSICS)
    np.testing.assert_allclose(back, [[38, 24], [30, 30]], atol=STRIDE)


def test_what_the_subject_covers_is_no_stray_at_any_depth(nearest):
    places = np.array([point(24, 30, away) for away in (1.0, 2.0, 5.0)])
    stray, ways = find_strays(places, nearest, INTRINSICS)
    assert len(stray) == 0 and ways.shape == (0, 3)


def test_a_pixel_lost_within_the_subject_and_a_rim_are_noise():
    depth = np.zeros((48, 64))
    depth[16:32, 20:40] = 2.0
    depth[24, 30] = 0.0
    places = np.array([point(24, 30, 2.0), point(24, 41, 2.0)])
    assert len(find_strays(places, find_nearest_shown(depth), INTRINSICS)[0]) == 0


def test_beside_nothing_nothing_sticks_out():
    empty = find_nearest_shown(np.zeros((48, 64)))
    places = np.array([point(24, 30, 2.0), point(2, 60, 3.0)])
    assert len(find_strays(places, empty, INTRINSICS)[0]) == 0


def test_points_out_of_the_picture_come_back_to_it(nearest):
    stray, ways = find_strays(np.array([point(24, 200, 2.0)]), nearest, INTRINSICS)
    assert len(stray) == 1 and ways[0, 0] < 0

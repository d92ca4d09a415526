from dataclasses import replace

import numpy as np
import pytest

from bunraku.registration.moments import no_moments
from bunraku.standing import ground_under, travel_scale, way_aside, way_home

HIPS = np.array([0.3, 1.0, 0.4])
HOME = np.array([0.0, 1.0, 0.0])


def standing_at(height: float) -> np.ndarray:
    """Give a figure 2 m high with its soles at this height."""
    return np.array([[0.0, height, 0.0], [0.0, height + 2.0, 0.0]])


def test_a_figure_found_at_rest_stays_on_its_own_ground():
    shift = way_home(standing_at(5.0), standing_at(4.9), HOME - HIPS, posed=False)
    np.testing.assert_allclose(shift, [0, 0.1, 0])


def test_a_figure_caught_in_motion_near_the_origin_goes_home():
    shift = way_home(standing_at(0.2), standing_at(0.1), HOME - HIPS, posed=True)
    np.testing.assert_allclose(shift, [-0.3, -0.1, -0.4], atol=1e-12)


def test_a_figure_caught_in_the_air_lands():
    high, above = standing_at(1.5), standing_at(1.7)  # of a height of 2
    assert way_home(high, high, HOME - HIPS, posed=True)[1] == pytest.approx(-1.5)
    assert way_home(above, above, HOME - HIPS, posed=True)[1] == 0.0


def test_a_figure_caught_in_motion_far_away_stays_there():
    far = standing_at(7.0)
    shift = way_home(far, far, HOME - HIPS * [10.0, 7.0, 1.0], posed=True)
    np.testing.assert_allclose(shift, 0, atol=1e-12)


def ways(body, hips: np.ndarray, middle: np.ndarray, *, alike: bool = False) -> np.ndarray:
    """Give the way to the source's place of a figure of its size, hips and middle so far off it."""
    own = body.areas @ body.proxy.mesh.vertices / body.areas.sum()
    at = body.joints[body.puppet.joints[0]] + hips, own + middle
    return way_aside(body, np.eye(3), *at, scale=1.0, alike=alike)


def test_an_unlike_figure_goes_as_far_ahead_as_hips_and_surface_agree(body):
    near, far = np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, 0.3])
    for hips, middle in ((near, far), (far, near)):
        np.testing.assert_allclose(ways(body, hips, middle), -near, atol=1e-12)
        np.testing.assert_allclose(ways(body, hips, -middle), 0, atol=1e-12)
        np.testing.assert_allclose(ways(body, hips, middle, alike=True), -hips, atol=1e-12)


def test_to_the_side_the_hips_are_right(body):
    aside = np.array([0.2, 0.0, 0.0])
    np.testing.assert_allclose(ways(body, aside, np.zeros(3)), -aside, atol=1e-12)


def test_ways_are_told_in_the_figures_heading(body):
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    own = body.areas @ body.proxy.mesh.vertices / body.areas.sum()
    at = body.joints[body.puppet.joints[0]] + np.array([0.2, 0, 0.1]), own + np.array([0, 0, 0.3])
    way = way_aside(body, quarter, *(quarter @ place for place in at), scale=1.0, alike=False)
    np.testing.assert_allclose(way, quarter @ [-0.2, 0.0, -0.1], atol=1e-12)


BODY = np.array([0.0, 1.8])


def test_the_ground_lies_where_most_limbs_end(body):
    feet = np.array([[0.0, 0, 0], [0, 0.1, 0], [0, -0.5, 0], [0, 0.2, 0]])
    table = replace(
        body,
        joints=np.array([[1.0, 1, 1], [-1, 1, 1], [1, 1, -1], [-1, 1, -1]]),
        parents=np.full(4, -1),
        carriers=np.full(4, -1),
        weights=np.tile(np.eye(4), (len(body.weights), 1))[: len(body.weights)],
        moments=no_moments(4),
    )  # four legs, each of which has some of the surface near the floor
    assert ground_under(feet, np.eye(4), table) == pytest.approx(0.05)  # not at the one that hangs
    assert ground_under(feet, np.eye(7)[:4], body) == -0.5  # on two legs both count


@pytest.mark.parametrize(
    ("hips", "heights", "scale"),
    [
        (0.5, [0.0, 0.9], 0.5),  # half the size
        (0.3, [0.0, 1.8], 0.3),  # short legs
        (1.3, [1.0, 2.8], 0.3),  # over its own ground
        (9.0, [0.0, 1.8], 1.8),  # a joint far above the body
        (-2.0, [0.0, 1.8], 0.25),  # and one below it
        (0.1, [0.0, 0.0], 1.0),  # a body without height
    ],
)
def test_travel_is_bounded_by_what_a_body_can_be(hips, heights, scale, caplog):
    found = travel_scale((1.0, hips), (BODY, np.array(heights)))
    assert found == pytest.approx(scale)
    assert ("travel is a guess" in caplog.text) == (not 0 < hips < 3)

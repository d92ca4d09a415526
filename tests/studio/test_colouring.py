import numpy as np

from bunraku.studio import colouring
from bunraku.studio.colouring import COLD, WARM


def test_weights_go_from_cold_to_warm():
    colours = colouring.colour_weights(np.array([0.0, 0.5, 1.0]))
    assert np.allclose(colours, [COLD, (COLD + WARM) / 2, WARM])


def test_joints_in_a_row_have_colours_apart():
    colours = colouring.colour_joints(np.arange(60))
    assert 0 <= colours.min() <= colours.max() <= 255
    assert np.linalg.norm(np.diff(colours, axis=0), axis=1).min() > 60
    assert len(np.unique(colours.astype(int), axis=0)) == 60


def test_a_joints_colour_is_its_own_whoever_else_is_there():
    alone, among = (colouring.colour_joints(np.array(some)) for some in ([7, 7], [1, 7, 3]))
    assert np.array_equal(alone[0], alone[1])
    assert np.array_equal(alone[0], among[1])


def test_places_are_coloured_within_the_performers_box(rng):
    rest = rng.random((300, 3)) * [1.0, 2.0, 3.0]
    colours = colouring.colour_places(rest, rest)
    assert np.allclose(colours[rest.argmin(axis=0), range(3)], 30.0)
    assert np.allclose(colours[rest.argmax(axis=0), range(3)], 255.0)
    assert np.array_equal(colouring.colour_places(rest[:5], rest), colours[:5])
    assert colouring.colour_places(rest + 100.0, rest).max() == 255.0


def test_a_flat_performer_has_colours():
    rest = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    assert np.allclose(colouring.colour_places(rest, rest)[:, 2], 30.0)

"""What is sent of a film; the page is a stand-in here."""

from types import SimpleNamespace

import numpy as np
import pytest

from bunraku.batching.footage import Footage
from bunraku.studio.screening import HIDDEN, VISIBLE, Screen
from tests.studio.test_dragging import Page


class Cinema(Page):
    """A page with pictures and clouds of points, which counts what is sent."""

    sent = 0

    def add_folder(self, name, *, visible):
        self.visible = visible
        return self

    def add_image(self, image, **more):
        return SimpleNamespace(image=image)

    def add_point_cloud(self, name, points, colors, **more):
        self.sent += 1
        return self._node(name, points=points, colors=colors, **more)


@pytest.fixture
def film(rng):
    visible = np.array([[True, False], [False, True], [True, True]])
    points = rng.normal(size=(2, 3, 2, 3)).astype(np.float32)
    pictures = np.arange(3, dtype=np.uint8)[:, None, None] * np.ones((1, 4, 5), np.uint8)
    return Footage(np.array([0.0, 0.5, 1.0]), pictures, *points, visible)


@pytest.fixture
def cinema():
    return Cinema()


@pytest.fixture
def screen(cinema, film):
    screen = Screen(cinema, lambda: None)
    screen.take(film, 1.5)
    return screen


def test_a_frame_is_sent_once(screen, cinema, film):
    screen.show(0.5)
    assert cinema.sent == 2
    np.testing.assert_array_equal(cinema.nodes["/film/seen"].points, film.seen[1])
    np.testing.assert_array_equal(cinema.nodes["/film/followed"].points, film.followed[1])
    np.testing.assert_array_equal(cinema.nodes["/film/followed"].colors, [HIDDEN, VISIBLE])
    assert cinema.nodes["/film/seen"].position == (1.5, 0, 0)
    assert (screen.picture.image == 1).all()
    screen.show(0.5)
    assert cinema.sent == 2
    screen.show(1.0)
    assert cinema.sent == 4


def test_what_is_not_wanted_is_not_sent(screen, cinema):
    screen.depths.value = False
    screen.show(0.0)
    assert set(cinema.nodes) == {"/film/followed"}
    screen.points.value = False
    screen.show(0.0)
    assert cinema.nodes == {}


def test_without_a_film_there_are_no_controls(screen, cinema):
    screen.show(0.0)
    screen.take(None, 0.0)
    screen.show(0.0)
    assert cinema.nodes == {}
    assert not screen.folder.visible

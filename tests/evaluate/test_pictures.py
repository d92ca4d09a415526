import numpy as np
import pytest

from bunraku.evaluate import pictures
from bunraku.evaluate.pictures import Camera, arrange, cast_rays, draw, in_light, look_at


@pytest.fixture
def camera():
    return Camera(np.array([0.5, 0.5, 0.5]), 3.0, (30, 30), turn=0.0, tilt=0.1)


@pytest.fixture
def red(cube):
    return np.tile([200.0, 0.0, 0.0], (len(cube.vertices), 1))


def test_a_ray_meets_the_near_side(cube):
    face, shares = cast_rays(
        np.array([[0.3, 0.6, 5.0], [3.0, 0.6, 5.0]]), np.array([0, 0, -1.0]), *_arrays(cube)
    )
    place = np.einsum("c,cx->x", shares[0], cube.vertices[cube.faces[face[0]]])
    np.testing.assert_allclose(place, [0.3, 0.6, 1.0], atol=1e-6)
    assert face[1] == -1


def _arrays(mesh):
    return mesh.vertices, mesh.faces


def test_the_figure_is_in_the_middle_in_its_colour(cube, red, camera):
    picture = draw(*_arrays(cube), red, camera)
    assert picture.shape == (30, 30, 3)
    assert picture[15, 15, 0] > 110  # in the light, not just under the sky
    assert picture[15, 15, 1] == 0
    np.testing.assert_array_equal(picture[1, 1], pictures.PAPER.astype(np.uint8))


def test_the_figure_covers_its_share_of_the_picture(cube, red):
    """Seen straight from the front, a unit cube fills a ninth of a 3 m picture."""
    front = Camera(np.array([0.5, 0.5, 0.5]), 3.0, (90, 90), turn=0.0, tilt=1e-9)
    picture = draw(*_arrays(cube), red, front, floor=-1e6)
    assert (picture[..., 1] == 0).mean() == pytest.approx(1 / 9, abs=0.002)


def test_under_the_figure_there_is_no_light(cube):
    places = np.array([[0.5, -0.5, 0.5], [5.0, -0.5, 0.5], [0.5, 1.0, 0.5]])
    np.testing.assert_array_equal(in_light(places, *_arrays(cube), reach=20.0), [False, True, True])


def test_the_floor_carries_a_shadow(cube, red, camera):
    picture = draw(*_arrays(cube), red, camera, floor=0.0)
    shaded = (pictures.PAPER * (1 - pictures.SHADE)).astype(np.uint8)
    assert (picture == shaded).all(axis=-1).any()


def test_every_frame_is_in_the_picture(cube):
    moved = cube.vertices + np.array([[[0.0, 0, 0]], [[4.0, 2.0, 0]]])
    camera = look_at(moved, (20, 40))
    seen = (moved.reshape(-1, 3) - camera.centre) @ camera.world_from_camera
    assert np.abs(seen[:, 1]).max() < camera.height / 2
    assert np.abs(seen[:, 0]).max() < camera.height / 4


def test_pictures_are_set_in_rows():
    white = np.full((10, 20, 3), 255, np.uint8)
    sheet = arrange([[white, white, white], [white, white, white]], ["first", "second"])
    assert sheet.size == (60, 20)
    assert np.asarray(sheet).min() < 200

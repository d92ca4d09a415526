import numpy as np

from bunraku import meshes
from bunraku.proxy import build_proxy, closed
from bunraku.types import Mesh
from tests.proxy.shapes import box, together


def test_a_closed_body_of_the_right_size_is_its_own_proxy(cube):
    fine = closed.split_long_edges(cube, 800)
    inverted = Mesh(fine.vertices, fine.faces[:, ::-1])
    for mesh in (fine, inverted):
        proxy = build_proxy(mesh.vertices, mesh.faces, vertex_count=len(fine.vertices))
        assert len(proxy.mesh.vertices) == len(fine.vertices)
        assert np.isclose(meshes.signed_volume(proxy.mesh.vertices, proxy.mesh.faces), 1)


def test_a_coarse_body_is_split_and_a_fine_one_collapsed(cube):
    fine = closed.split_long_edges(cube, 10_000)
    for mesh in (cube, fine):
        result = closed.resample(mesh, 1000)
        assert result is not None and abs(len(result.vertices) - 1000) < 10
        assert abs(meshes.signed_volume(result.vertices, result.faces) - 1) < 0.05


def test_small_holes_are_closed_and_large_ones_are_not(cube):
    assert closed.close_holes(Mesh(cube.vertices, cube.faces[:-1]), 1.0) is None
    healed = closed.close_holes(Mesh(cube.vertices, cube.faces[:-1]), 4.0)
    assert healed is not None and meshes.is_closed(healed.faces)
    assert np.isclose(meshes.signed_volume(healed.vertices, healed.faces), 1)


def test_a_body_with_buttons_on_it_stands_for_all():
    body, button = box((0, 0, 0), (1, 1, 1)), box((0.4, 0.4, 1.0), (0.5, 0.5, 1.02))
    found = closed.closed_body(together(body, button))
    assert found is not None and len(found.vertices) == 8


def test_a_body_with_a_hat_does_not():
    body, hat = box((0, 0, 0), (1, 1, 1)), box((0.2, 1.0, 0.2), (0.8, 1.5, 0.8))
    assert closed.closed_body(together(body, hat)) is None


def test_a_surface_that_cuts_through_itself_is_not_clean_enough():
    crossed = together(box((0, 0, 0), (1, 1, 1)), box((0.5, 0.2, 0.2), (1.6, 0.8, 0.8)))
    assert closed.cuts_itself(crossed)
    assert not closed.cuts_itself(box((0, 0, 0), (1, 1, 1)))


def test_simplify_keeps_a_far_figure_in_place(cube):
    fine = closed.split_long_edges(cube, 10_000)
    moved = closed.simplify(Mesh(fine.vertices + 1000.0, fine.faces), 500)
    assert len(moved.faces) <= 520
    np.testing.assert_allclose(moved.vertices.max(axis=0), 1001, atol=0.01)

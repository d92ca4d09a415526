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


def test_halve_edges_by_hand():
    right = Mesh(np.array([[0.0, 0, 0], [4, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]]))
    none, two, three = (closed.halve_edges(right, longest) for longest in (5.0, 3.0, 1.0))
    assert none.faces.tolist() == [[1, 2, 0]]  # the longest edge first
    assert two.vertices[3:].tolist() == [[2, 0, 0], [2, 1, 0]] and len(two.faces) == 3
    assert three.vertices[3:].tolist() == [[2, 0, 0], [0, 1, 0], [2, 1, 0]]
    assert len(three.faces) == 4
    for mesh in (two, three):
        assert np.isclose(meshes.face_normals(mesh.vertices, mesh.faces)[:, 2].sum(), 8)


def test_halved_edges_leave_no_gap(cube):
    halved = closed.halve_edges(closed.halve_edges(cube, 1.2), 0.6)
    assert meshes.is_closed(halved.faces) and len(halved.faces) > 40
    assert np.isclose(meshes.signed_volume(halved.vertices, halved.faces), 1)


def test_thin_triangles_do_not_beget_a_crowd():
    angles = np.linspace(0, 2 * np.pi, 32, endpoint=False)
    ring = 0.05 * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    vertices = np.vstack([ring, ring + np.array([0, 0, 2]), [[0, 0, 0], [0, 0, 2]]])
    here, ahead = np.arange(32), np.roll(np.arange(32), -1)
    faces = [(here, ahead, here + 32), (ahead, ahead + 32, here + 32)]
    faces += [(ahead, here, 0 * here + 64), (here + 32, ahead + 32, 0 * here + 65)]
    rod = Mesh(vertices, np.concatenate([np.stack(three, axis=1) for three in faces]))
    fine = closed.split_long_edges(rod, 1000)
    assert 1000 <= len(fine.vertices) <= 18_000 and closed.is_clean(fine)
    result = closed.resample(rod, 1000)
    assert result is not None and abs(len(result.vertices) - 1000) < 10
    assert np.isclose(np.ptp(result.vertices[:, 2]), 2, atol=0.02)


def test_what_stands_in_is_clean_outward_and_of_the_right_size(cube):
    assert closed.stands_in(cube, 8)
    assert not closed.stands_in(cube, 20) and not closed.stands_in(cube, 3)
    assert not closed.stands_in(Mesh(cube.vertices, cube.faces[:, ::-1]), 8)
    assert not closed.stands_in(Mesh(cube.vertices, cube.faces[1:]), 8)


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

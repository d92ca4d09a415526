import numpy as np

from bunraku import meshes
from bunraku.proxy import build_proxy, lift, lift_weights


def test_open_cube_gets_a_closed_proxy(cube):
    proxy = build_proxy(cube.vertices, cube.faces[:-1], vertex_count=1000)
    assert meshes.is_closed(proxy.mesh.faces)
    assert abs(meshes.signed_volume(proxy.mesh.vertices, proxy.mesh.faces) - 1) < 0.1


def test_lifted_positions_lie_near_the_figure(cube):
    proxy = build_proxy(cube.vertices, cube.faces, vertex_count=1000)
    assert np.abs(lift(proxy, proxy.mesh.vertices) - cube.vertices).max() < 0.05


def test_vertices_at_one_place_get_one_row(cube, rng):
    doubled = np.vstack([cube.vertices, cube.vertices])
    proxy = build_proxy(doubled, cube.faces, vertex_count=1000)
    weights = rng.dirichlet(np.ones(3), size=len(proxy.mesh.vertices))
    lifted = lift_weights(proxy, weights, doubled, cube.faces)
    assert np.array_equal(lifted[:8], lifted[8:])
    np.testing.assert_allclose(lifted.sum(axis=1), 1)

import numpy as np
import pytest

from bunraku import meshes
from bunraku.proxy import Proxy, build_proxy, lift, lift_weights, lifting
from tests.proxy.shapes import box, together


@pytest.fixture
def tower():
    """A finely split column 1 m tall whose weights go over from joint 0 to joint 1 with height."""
    from bunraku.proxy.closed import split_long_edges

    return split_long_edges(box((0, 0, 0), (0.2, 1, 0.2)), 500)


def ramp(proxy: Proxy) -> np.ndarray:
    share = np.clip((proxy.mesh.vertices[:, 1] - 0.4) / 0.2, 0, 1)
    return np.column_stack([1 - share, share])


def test_lift_agrees_with_the_plain_sum(tower, rng):
    proxy = build_proxy(tower.vertices, tower.faces, vertex_count=300)
    for values in (
        rng.random(len(proxy.mesh.vertices)),
        rng.random((len(proxy.mesh.vertices), 2, 3)),
    ):
        plain = meshes.interpolate(values, proxy.corners, proxy.barycentric)
        np.testing.assert_allclose(lift(proxy, values), plain)


def test_a_column_keeps_its_ramp_and_its_cap_moves_as_a_whole(tower):
    cap = box((-0.02, 0.503, 0.2), (0.047, 0.563, 0.24))
    figure = together(tower, cap)
    proxy = build_proxy(figure.vertices, figure.faces, vertex_count=1000)
    lifted = lift_weights(proxy, ramp(proxy), figure.vertices, figure.faces)
    np.testing.assert_allclose(lifted.sum(axis=1), 1)
    assert np.ptp(lifted[-8:], axis=0).max() == 0
    assert np.ptp(lifted[:-8, 0]) > 0.95


def test_a_sleeve_that_spans_two_joints_keeps_its_weights(tower):
    from bunraku.proxy.closed import split_long_edges

    sleeve = split_long_edges(box((-0.01, 0.2, -0.01), (0.21, 0.8, 0.21)), 300)
    figure = together(tower, sleeve)
    proxy = build_proxy(figure.vertices, figure.faces, vertex_count=1000)
    lifted = lift_weights(proxy, ramp(proxy), figure.vertices, figure.faces)
    assert np.ptp(lifted[len(tower.vertices) :, 0]) > 0.9


def test_the_hidden_end_of_an_arm_belongs_to_the_arm():
    vertices = np.array([[float(x), y, 0] for x in range(4) for y in (0.0, 1)])
    faces = np.array([f for i in (0, 2, 4) for f in ((i, i + 2, i + 1), (i + 1, i + 2, i + 3))])
    hidden = np.array([True, True, True, True, False, False, False, False])
    nearest = lifting.nearest_seen(vertices, faces, hidden)
    assert nearest.tolist() == [4, 5, 4, 5, 4, 5, 6, 7]
    assert lifting.nearest_seen(vertices, faces, ~np.zeros(8, bool)).tolist() == list(range(8))


def test_hidden_vertices_stored_twice_find_the_same_way():
    vertices = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    faces = np.array([[0, 2, 1], [3, 5, 4]])  # one square, its diagonal stored twice
    hidden = np.array([True, True, False, False, True, False])
    nearest = lifting.nearest_seen(vertices, faces, hidden)
    assert nearest[2:4].tolist() == [2, 3] and nearest[5] == 5
    assert nearest[0] in (2, 3) and nearest[1] == nearest[4] == 5


def test_extents_of_parts_by_hand():
    vertices = np.array([[0.0, 0, 0], [9, 0, 0], [0, 2, 0], [5, 0, 0], [10, 1, 0]])
    extents = lifting.part_extents(vertices, np.array([0, 1, 0, 2, 1]), 3)
    np.testing.assert_allclose(extents, [0.2, 0.1, 0])


def test_part_means_by_hand():
    values, areas = np.array([[1.0, 0], [0, 1], [0.5, 0.5]]), np.array([3.0, 1, 2])
    mean, spread = lifting.part_means(values, np.array([0, 0, 1]), areas, 2)
    np.testing.assert_allclose(mean, [[0.75, 0.25], [0.5, 0.5]])
    np.testing.assert_allclose(spread, [0.75 * 0.25 + 0.25 * 0.75, 0])


def test_which_parts_move_as_wholes_by_hand():
    #         dust  even  ruled  body  glove
    mean = np.array([[1.0, 0], [0.5, 0.5], [0.8, 0.2], [0.8, 0.2], [0.5, 0.5]])
    spread = np.array([0.0, 0.05, 0.25, 0.25, 0.5])
    share = np.array([1e-5, 0.1, 0.1, 0.5, 0.1])
    extent = np.array([0.01, 0.3, 0.3, 1.0, 0.08])
    whole = lifting.moves_as_whole(mean, spread, share, extent)
    assert whole.tolist() == [False, True, True, False, False]


def test_sharpen_by_hand():
    np.testing.assert_allclose(lifting.sharpen(np.array([[0.75, 0.25]])), [[27 / 28, 1 / 28]])


def test_a_cloud_is_lifted_as_it_is(rng):
    points = rng.normal(size=(3000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    none = np.zeros((0, 3), np.int64)
    proxy = build_proxy(points, none, vertex_count=500)
    weights = rng.dirichlet(np.ones(3), size=len(proxy.mesh.vertices))
    assert np.array_equal(lift_weights(proxy, weights, points, none), lift(proxy, weights))

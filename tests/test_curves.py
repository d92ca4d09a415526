import numpy as np
import pytest

from bunraku.curves import centre_nodes, extract_curves, prune, span_tree
from bunraku.meshes import vertex_normals


def half_tube(columns=60, ring=16, radius=0.1):
    """The upper half of a tube along X, two metres long: what a camera above it sees."""
    x, angle = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(0, np.pi, ring))
    vertices = np.column_stack(
        [x.ravel(), radius * np.cos(angle).ravel(), radius * np.sin(angle).ravel()]
    )
    number = np.arange(x.size).reshape(ring, columns)
    quads = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    here, right, below, across = (block.ravel() for block in quads)
    faces = np.concatenate([np.stack([here, right, below], 1), np.stack([right, across, below], 1)])
    return vertices, faces


def test_half_a_tube_is_one_curve_near_its_axis(capfd):
    vertices, faces = half_tube()
    skeleton = extract_curves(vertices, faces)
    degree = np.bincount(skeleton.edges.ravel())
    assert (degree == 1).sum() == 2 and degree.max() == 2
    assert np.ptp(skeleton.nodes[:, 0]) > 1.6
    inner = np.abs(skeleton.nodes[:, 0]) < 0.8
    off = np.linalg.norm(skeleton.nodes[inner, 1:], axis=1)
    assert off.mean() < 0.04  # the mean of a half ring lies .064 from the axis
    assert skeleton.owners.shape == (len(vertices),)
    assert capfd.readouterr().out == ""


def test_the_same_surface_gives_the_same_skeleton():
    surface = half_tube(columns=40)
    first, second = extract_curves(*surface), extract_curves(*surface)
    np.testing.assert_array_equal(first.nodes, second.nodes)
    np.testing.assert_array_equal(first.owners, second.owners)


def test_nodes_go_to_where_the_normals_of_a_half_ring_meet():
    vertices, faces = half_tube(columns=9)
    owners = np.digitize(vertices[:, 0], np.linspace(-1, 1, 4)[1:-1])
    start = np.array([[-0.7, 0, 0.1], [0, 0, 0.1], [0.7, 0, 0.1]])
    edges = np.array([[0, 1], [1, 2]])
    normals = vertex_normals(vertices, faces)
    outwards = normals * np.sign(np.einsum("va,va->v", normals, vertices * [0, 1, 1]))[:, None]
    plain = centre_nodes(vertices, outwards, owners, start, edges, shares=(0.0, 1.0, 0.0))
    np.testing.assert_allclose(plain[1], vertices[owners == 1].mean(axis=0), atol=1e-9)
    centred = centre_nodes(vertices, outwards, owners, start, edges, shares=(0.8, 0.2, 0.0))
    assert abs(centred[1, 2]) < 0.6 * plain[1, 2]


def test_a_node_without_surface_stays_where_its_neighbours_put_it():
    vertices = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    nodes = np.array([[0.0, 0, 0], [1.0, 5.0, 0], [2.0, 0, 0]])
    edges = np.array([[0, 1], [1, 2]])
    found = centre_nodes(vertices, np.zeros((2, 3)), np.array([0, 2]), nodes, edges)
    assert np.isfinite(found).all()


def test_cycles_open_at_their_longest_edge_and_parts_join_where_nearest():
    nodes = np.array([[0.0, 0, 0], [1, 0, 0], [1.5, 1, 0], [0, 3, 0], [9, 0, 0], [8, 0, 0]])
    tree = span_tree(nodes, np.array([[0, 1], [1, 2], [2, 3], [0, 3], [4, 5]]))
    assert tree == {0: {1}, 1: {0, 2}, 2: {1, 3, 5}, 3: {2}, 4: {5}, 5: {4, 2}}


@pytest.mark.parametrize(("length", "left"), [(0.02, 5), (0.5, 8)])
def test_branches_that_hardly_stick_out_are_pruned(length, left):
    nodes = np.array(
        [[x, 0.0, 0] for x in (-2, -1, 0, 1, 2)] + [[0, length * k, 0] for k in (1, 2, 3)]
    )
    tree = {0: {1}, 1: {0, 2}, 2: {1, 3, 5}, 3: {2, 4}, 4: {3}, 5: {2, 6}, 6: {5, 7}, 7: {6}}
    owners = np.arange(8)
    reach = np.array([0.3, 0.3, 0.3, 0.3, 0.3, 0.01, 0.01, 0.01])
    found = prune(tree, nodes, owners, reach)
    assert len(tree) == left
    assert set(found) <= set(tree)

import numpy as np
import pytest

from bunraku import graphs

PARENTS = np.array([-1, 0, 1, 0, 3, 3])  # 0 > (1 > 2), 0 > 3 > (4, 5)


def test_descendants_by_hand():
    below = graphs.descendants(PARENTS)
    assert np.flatnonzero(below[3]).tolist() == [3, 4, 5]
    assert np.flatnonzero(below[:, 2]).tolist() == [0, 1, 2]
    assert graphs.subtree(PARENTS, 1).tolist() == [1, 2]


def test_children_and_depths_by_hand():
    assert graphs.children(PARENTS) == [[1, 3], [2], [], [4, 5], [], []]
    assert graphs.depths(PARENTS).tolist() == [0, 1, 2, 1, 2, 2]


def test_ancestors_start_with_the_joint_itself():
    assert graphs.ancestors(PARENTS, 5) == [5, 3, 0]
    assert graphs.ancestors(PARENTS, 0) == [0]


def test_joint_path_goes_over_the_meeting_joint():
    assert graphs.joint_path(PARENTS, 2, 5) == [2, 1, 0, 3, 5]
    assert graphs.joint_path(PARENTS, 5, 3) == [5, 3]
    assert graphs.joint_path(PARENTS, 4, 4) == [4]


def test_joint_path_across_roots():
    with pytest.raises(ValueError, match="joints 1 and 2 hang on different roots"):
        graphs.joint_path(np.array([-1, 0, -1]), 1, 2)


def test_root_first_sorts_a_shuffled_tree(rng):
    shuffle = rng.permutation(6)
    shuffled = np.full(6, -1)
    for joint, parent in enumerate(PARENTS):
        shuffled[shuffle[joint]] = -1 if parent < 0 else shuffle[parent]
    order = graphs.root_first(shuffled)
    place = np.argsort(order)
    assert sorted(order) == list(range(6))
    assert all(parent < 0 or place[parent] < place[joint] for joint, parent in enumerate(shuffled))


def test_root_first_refuses_a_cycle():
    with pytest.raises(ValueError, match=r"joints \[1, 2, 3\] are on or below a cycle"):
        graphs.root_first(np.array([-1, 2, 1, 2]))


def test_mesh_edges_of_a_cube(cube):
    edges = graphs.mesh_edges(cube.faces)
    lengths = graphs.edge_lengths(cube.vertices, edges)
    assert len(edges) == 18  # twelve sides and six diagonals
    assert np.isclose(lengths, 1).sum() == 12 and np.isclose(lengths, np.sqrt(2)).sum() == 6
    matrix = graphs.adjacency(edges, lengths, 8).toarray()
    assert np.array_equal(matrix, matrix.T) and np.count_nonzero(matrix) == 36


def test_geodesic_distances_agree_with_floyd_warshall(cube):
    distances = graphs.geodesic_distances(cube.vertices, cube.faces, np.arange(8))
    plain = np.full((8, 8), np.inf)
    np.fill_diagonal(plain, 0)
    for a, b in graphs.mesh_edges(cube.faces):
        plain[a, b] = plain[b, a] = np.linalg.norm(cube.vertices[a] - cube.vertices[b])
    for middle in range(8):
        plain = np.minimum(plain, plain[:, [middle]] + plain[[middle]])
    np.testing.assert_allclose(distances, plain)


def test_geodesic_distance_to_another_part_is_infinite():
    vertices = np.vstack([np.eye(3), np.eye(3) + 5])
    distances = graphs.geodesic_distances(vertices, np.array([[0, 1, 2], [3, 4, 5]]), np.array([0]))
    np.testing.assert_allclose(distances[0], [0, 2**0.5, 2**0.5, np.inf, np.inf, np.inf])


def test_geodesics_cross_an_edge_without_length():
    vertices = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 0]])
    distances = graphs.geodesic_distances(vertices, np.array([[0, 1, 2], [1, 2, 3]]), np.array([0]))
    assert np.isclose(distances[0, 3], np.sqrt(2))

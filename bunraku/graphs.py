"""Joint trees and mesh graphs: descendants, ancestors, order, paths, edges, geodesic distances."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from bunraku.types import NO_PARENT


def children(parents: Int[np.ndarray, " joints"]) -> list[list[int]]:
    """List the children of each joint, in their own order."""
    lists: list[list[int]] = [[] for _ in parents]
    for joint, parent in enumerate(parents):
        if parent != NO_PARENT:
            lists[parent].append(joint)
    return lists


def descendants(parents: Int[np.ndarray, " joints"]) -> Bool[np.ndarray, "joints joints"]:
    """Tell whether the joint of a column hangs below the joint of a row; each below itself."""
    below = np.eye(len(parents), dtype=bool)
    for joint in root_first(parents)[::-1]:
        if parents[joint] != NO_PARENT:
            below[parents[joint]] |= below[joint]
    return below


def subtree(parents: Int[np.ndarray, " joints"], joint: int) -> Int[np.ndarray, " below"]:
    """List a joint and everything that hangs below it, parents first."""
    return np.flatnonzero(descendants(parents)[joint])


def depths(parents: Int[np.ndarray, " joints"]) -> Int[np.ndarray, " joints"]:
    """Count the joints above each joint; zero for a root. Any order of storage will do."""
    depth = np.zeros(len(parents), np.int64)
    above = parents.copy()
    while (above != NO_PARENT).any():
        depth += above != NO_PARENT
        above = np.where(above == NO_PARENT, NO_PARENT, parents[above])
    return depth


def root_first(parents: Int[np.ndarray, " joints"]) -> Int[np.ndarray, " joints"]:
    """Give an order of the joints in which every parent comes before its children.

    Args:
        parents: in any order, as a file may store them.

    Raises:
        ValueError: if the joints form a cycle.
    """
    order = [joint for joint, parent in enumerate(parents) if parent == NO_PARENT]
    below = children(parents)
    for joint in order:  # grows while it is read: breadth first
        order.extend(below[joint])
    if len(order) < len(parents):
        missing = sorted(set(range(len(parents))) - set(order))
        raise ValueError(
            f"the joint tree must start at roots, but joints {missing} are on or below a cycle: "
            "give one of them no parent"
        )
    return np.array(order, np.int64)


def ancestors(parents: Int[np.ndarray, " joints"], joint: int) -> list[int]:
    """List a joint, its parent, and so on up to its root."""
    chain = [joint]
    while parents[chain[-1]] != NO_PARENT:
        chain.append(int(parents[chain[-1]]))
    return chain


def joint_path(parents: Int[np.ndarray, " joints"], source: int, target: int) -> list[int]:
    """List the joints on the way from one joint to another, both included.

    Raises:
        ValueError: if they hang on different roots.
    """
    up, down = ancestors(parents, source), ancestors(parents, target)
    meeting = next((joint for joint in up if joint in down), None)
    if meeting is None:
        raise ValueError(f"joints {source} and {target} hang on different roots: no path")
    return up[: up.index(meeting) + 1] + down[: down.index(meeting)][::-1]


def mesh_edges(faces: Int[np.ndarray, "faces 3"]) -> Int[np.ndarray, "edges 2"]:
    """List each edge of a mesh once, the smaller vertex first, sorted."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(ends, axis=0)


def edge_lengths(
    vertices: Float[np.ndarray, "vertices 3"], edges: Int[np.ndarray, "edges 2"]
) -> Float[np.ndarray, " edges"]:
    """Measure the edges, in metres."""
    return np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)


def adjacency(
    edges: Int[np.ndarray, "edges 2"], weights: Float[np.ndarray, " edges"], count: int
) -> csr_array:
    """Build the symmetric sparse matrix of an undirected graph with `count` nodes."""
    rows, columns = edges.T
    both = np.concatenate([rows, columns]), np.concatenate([columns, rows])
    return csr_array((np.tile(weights, 2), both), shape=(count, count))


def geodesic_distances(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    sources: Int[np.ndarray, " sources"],
) -> Float[np.ndarray, "sources vertices"]:
    """Measure the way along mesh edges from each source vertex; infinite on other parts.

    Reference:
        Dijkstra 1959; longer than the true geodesic by up to 15 % on even triangles.
    """
    edges = mesh_edges(faces)
    # zero-length edges would read as absent
    lengths = np.maximum(edge_lengths(vertices, edges), 1e-300)
    graph = adjacency(edges, lengths, len(vertices))
    return dijkstra(graph, directed=False, indices=sources)

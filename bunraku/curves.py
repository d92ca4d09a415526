"""The curve skeleton of a surface that may be seen from one side only (Transfer4D, Sec. 4.2).

Nodes come from local separators (Baerentzen and Rotenberg 2021, "Skeletonization via local
separators", through PyGEL), which need no closed surface; the tree is then pruned, and its nodes
are moved from the seen surface towards the middle (Eq. 7).
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import fast_simplification
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from bunraku.graphs import adjacency, edge_lengths, mesh_edges
from bunraku.meshes import vertex_normals, weld

VERTICES = 900  # of the surface that separators are sought on
SHORTEST = 3  # nodes of a branch (Sec. 4.2)
LONG = 2.0  # a branch is kept if it is longer than this, in radii of its junction
Tree = dict[int, set[int]]


@dataclass(frozen=True, eq=False)
class CurveSkeleton:
    """A tree of nodes in the middle of a surface; each owns a ring or strip of vertices."""

    nodes: Float[np.ndarray, "nodes 3"]
    edges: Int[np.ndarray, "edges 2"]
    owners: Int[np.ndarray, " vertices"]  # node of each vertex


def extract_curves(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> CurveSkeleton:
    """Find the curve skeleton of a surface, open or closed, of one part or several."""
    small, few = decimate(vertices, faces, VERTICES)
    nodes, edges, owner = separate(small, few)
    tree = span_tree(nodes, edges)
    reach = np.linalg.norm(small - nodes[owner], axis=1)
    owner = prune(tree, nodes, owner, reach)
    kept = np.array(sorted(tree), np.int64)
    number = np.full(len(nodes), -1)
    number[kept] = np.arange(len(kept))
    ends = [(a, b) for a, others in tree.items() for b in others if a < b]
    edges = number[np.array(ends, np.int64).reshape(-1, 2)]
    owner = number[owner]
    centred = centre_nodes(small, vertex_normals(small, few), owner, nodes[kept], edges)
    return CurveSkeleton(centred, edges, owner[cKDTree(small).query(vertices)[1]])


def decimate(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], count: int
) -> tuple[Float[np.ndarray, "fewer 3"], Int[np.ndarray, "kept 3"]]:
    """Bring a surface to about so many vertices."""
    if len(vertices) <= count:
        return vertices, faces
    share = 1 - count / len(vertices)
    small, few = fast_simplification.simplify(
        vertices.astype(np.float32), faces.astype(np.int32), share
    )
    welded, kept, _ = weld(small.astype(np.float64), few.astype(np.int64))
    used = np.unique(kept)
    number = np.full(len(welded), -1)
    number[used] = np.arange(len(used))
    return welded[used], number[kept]


@contextmanager
def silence() -> Iterator[None]:
    """Keep C code from writing on the standard output."""
    sys.stdout.flush()
    saved, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(nowhere)


def separate(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, "nodes 3"], Int[np.ndarray, "edges 2"], Int[np.ndarray, " vertices"]]:
    """Find local separators: nodes, edges between them, and the node of each vertex."""
    from pygel3d import graph as gel  # slow to import, and only needed here

    surface = gel.Graph()
    for place in vertices:
        surface.add_node(place)
    for first, second in mesh_edges(faces):
        surface.connect_nodes(int(first), int(second))
    with silence():
        # neither sampled nor multi-scale: both draw numbers that no seed holds
        skeleton, mapped = gel.LS_skeleton_and_map(surface, False)
    live = np.array(list(skeleton.nodes()), np.int64)
    nodes = np.array(skeleton.positions())
    pairs = [(node, int(other)) for node in live for other in skeleton.neighbors(int(node))]
    number = np.full(len(nodes), -1)
    number[live] = np.arange(len(live))
    edges = number[np.array(pairs, np.int64).reshape(-1, 2)]
    owner = np.array(list(mapped), np.int64)[: len(vertices)]
    owner = np.where(owner >= 0, number[owner], -1)
    lost = owner < 0
    if lost.any():
        owner[lost] = owner[~lost][cKDTree(vertices[~lost]).query(vertices[lost])[1]]
    return nodes[live], np.unique(np.sort(edges, axis=1), axis=0), owner


def span_tree(nodes: Float[np.ndarray, "nodes 3"], edges: Int[np.ndarray, "edges 2"]) -> Tree:
    """Open cycles at their longest edges, and join parts where they are nearest."""
    count = len(nodes)
    lengths = np.maximum(edge_lengths(nodes, edges), 1e-12)
    forest = minimum_spanning_tree(adjacency(edges, lengths, count))
    tree: Tree = {node: set() for node in range(count)}
    for first, second in zip(*forest.nonzero(), strict=True):
        tree[int(first)].add(int(second))
        tree[int(second)].add(int(first))
    parts, part = connected_components(forest, directed=False)
    while parts > 1:
        smallest = int(np.bincount(part).argmin())
        inside, outside = np.flatnonzero(part == smallest), np.flatnonzero(part != smallest)
        distance, other = cKDTree(nodes[outside]).query(nodes[inside])
        nearest = int(distance.argmin())
        first, second = int(inside[nearest]), int(outside[other[nearest]])
        tree[first].add(second)
        tree[second].add(first)
        part[inside] = part[second]
        part = np.unique(part, return_inverse=True)[1]
        parts -= 1
    return tree


def prune(
    tree: Tree,
    nodes: Float[np.ndarray, "nodes 3"],
    owner: Int[np.ndarray, " vertices"],
    reach: Float[np.ndarray, " vertices"],
) -> Int[np.ndarray, " vertices"]:
    """Remove, shortest first, branches that stick out of their junction hardly or not at all.

    Paper: branches of up to 3 nodes. We: also those shorter than the radius of their junction,
    because a surface seen from one side has many (docs/log.md).

    Args:
        tree: changed in place.
        owner: node of each vertex.
        reach: distance of each vertex to its node.

    Returns:
        the node of each vertex after pruning.
    """
    owner = owner.copy()
    while spurious := spurious_branches(tree, nodes, owner, reach):
        _, path = min(spurious)
        for node in path[:-1]:
            for other in tree.pop(node):
                if other in tree:
                    tree[other].discard(node)
            owner[owner == node] = path[-1]
    return owner


def spurious_branches(
    tree: Tree,
    nodes: Float[np.ndarray, "nodes 3"],
    owner: Int[np.ndarray, " vertices"],
    reach: Float[np.ndarray, " vertices"],
) -> list[tuple[float, list[int]]]:
    """List the branches, length and path, that hardly stick out of their junction."""
    radius = np.zeros(len(nodes))
    np.maximum.at(radius, owner, reach)
    found = []
    for leaf in [node for node, others in tree.items() if len(others) == 1]:
        path = branch(tree, leaf)
        if len(tree[path[-1]]) < 3:
            continue  # the whole tree is one curve
        length = float(np.linalg.norm(np.diff(nodes[path], axis=0), axis=1).sum())
        length += radius[leaf] / 2
        # the junction itself may own nothing: the rings around it tell how thick the body is
        thick = radius[[path[-1], *tree[path[-1]]]].max()
        few = len(path) - 1 < SHORTEST
        if length < (1.5 if few else 1.0) * LONG * thick:
            found.append((length, path))
    return found


def branch(tree: Tree, leaf: int) -> list[int]:
    """Walk from a leaf to the first node that is no passage."""
    path, previous = [leaf], -1
    while True:
        onward = [node for node in tree[path[-1]] if node != previous]
        if not onward or (len(path) > 1 and len(tree[path[-1]]) > 2):
            return path
        previous = path[-1]
        path.append(onward[0])


def centre_nodes(
    vertices: Float[np.ndarray, "vertices 3"],
    normals: Float[np.ndarray, "vertices 3"],
    owner: Int[np.ndarray, " vertices"],
    nodes: Float[np.ndarray, "nodes 3"],
    edges: Int[np.ndarray, "edges 2"],
    *,
    shares: tuple[float, float, float] = (0.8, 0.2, 200.0),
) -> Float[np.ndarray, "nodes 3"]:
    """Move nodes to where the normals of their rings meet (Eq. 7): one linear system.

    Args:
        owner: node of each vertex.
        nodes: kept where a node owns no vertex.
        shares: weights of normals, of the ring's mean, and of smoothness (Supplement 3.1), the last
            for a surface of the paper's 70,000 vertices: fewer vertices pull less.
    """
    count = len(nodes)
    across, near, smooth = shares
    smooth *= len(vertices) / 70_000
    pull = across * (np.eye(3) - normals[:, :, None] * normals[:, None]) + near * np.eye(3)
    blocks, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(blocks, owner, pull)
    np.add.at(right, owner, np.einsum("vab,vb->va", pull, vertices))
    alone = np.bincount(owner, minlength=count) == 0
    blocks[alone], right[alone] = near * np.eye(3), near * nodes[alone]
    system = np.zeros((count, 3, count, 3))
    own = np.arange(count)
    system[own, :, own, :] = blocks
    ends = np.concatenate([edges, edges[:, ::-1]])
    weights = np.full(len(ends), smooth)
    ties = coo_array((weights, tuple(ends.T)), (count, count)).toarray()
    laplacian = np.diag(ties.sum(axis=1)) - ties
    for axis in range(3):
        system[:, axis, :, axis] += laplacian
    return np.linalg.solve(system.reshape(3 * count, -1), right.ravel()).reshape(count, 3)

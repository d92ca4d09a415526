"""A deformation graph: a surface moved by the rigid motions of nodes spread over it.

After Sumner, Schmid, Pauly 2007, "Embedded deformation for shape manipulation". Equation numbers:
Maheshwari et al. 2023, "Transfer4D". Gauss-Newton with analytic derivatives. A graph has one or two
hundred nodes: a dense Cholesky factor takes less time than a sparse or banded one (docs/log.md).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from bunraku.graphs import adjacency, edge_lengths, mesh_edges
from bunraku.meshes import sum_rows
from bunraku.rotations import matrices_to_vectors, vectors_to_matrices

INFLUENCES, NEIGHBOURS = 4, 8  # nodes of a vertex, neighbours of a node (Sec. 3.1)
PART = 4  # radii along the surface up to which vertices belong together
BRIDGE = 4  # nodes on each side of a bridge between parts that do not touch
Points = Float[np.ndarray, "points 3"]


@dataclass(frozen=True, eq=False)
class Graph:
    """Nodes on a surface, which of them move each vertex, and which belong together."""

    nodes: Float[np.ndarray, "nodes 3"]
    influences: Int[np.ndarray, "vertices 4"]  # nodes of each vertex
    weights: Float[np.ndarray, "vertices 4"]  # rows sum to 1 (Eq. 3)
    edges: Int[np.ndarray, "edges 2"]
    pivots: Float[np.ndarray, "edges 3"]  # at rest: where both ends of an edge must agree
    bends: Float[np.ndarray, " edges"]  # cost of turning one end against the other
    near: Bool[np.ndarray, "nodes nodes"]  # less than PART radii apart along the surface

    def same_part(
        self, first: Int[np.ndarray, " points"], second: Int[np.ndarray, " points"]
    ) -> Bool[np.ndarray, " points"]:
        """Tell which vertices are near each other along the surface, pair by pair."""
        mine, other = (
            np.take_along_axis(
                self.influences[rows], self.weights[rows].argmax(axis=1)[:, None], axis=1
            )[:, 0]
            for rows in (first, second)
        )
        return self.near[mine, other]


@dataclass(frozen=True, eq=False)
class Motion:
    """Where each node has gone: it turns about its place at rest, then moves."""

    rotations: Float[np.ndarray, "*frames nodes 3 3"]
    translations: Float[np.ndarray, "*frames nodes 3"]


def build_graph(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], radius: float
) -> Graph:
    """Spread nodes over a surface and tie them together along it (Eq. 3).

    Args:
        radius: every vertex has a node within it along the surface; also the width of the weights.
    """
    edges = mesh_edges(faces)
    lengths = np.maximum(edge_lengths(vertices, edges), 1e-12)
    surface = adjacency(edges, lengths, len(vertices))
    chosen = cover(surface, radius)
    away = dijkstra(surface, directed=False, indices=chosen, limit=6 * radius).T
    nearest = np.argsort(away, axis=1)[:, :INFLUENCES]
    distance = np.take_along_axis(away, nearest, axis=1)
    weights = np.exp(-(np.minimum(distance, 1e3 * radius) ** 2) / (2 * radius**2))
    weights[~np.isfinite(distance)] = 0.0
    nearest = np.where(np.isfinite(distance), nearest, nearest[:, :1])
    if nearest.shape[1] < INFLUENCES:  # fewer nodes than influences
        short = INFLUENCES - nearest.shape[1]
        nearest = np.pad(nearest, [(0, 0), (0, short)], mode="edge")
        weights = np.pad(weights, [(0, 0), (0, short)])
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1e-30)
    order = np.argsort(nearest, axis=1, kind="stable")
    nearest = np.take_along_axis(nearest, order, axis=1)
    weights = np.take_along_axis(weights, order, axis=1)
    nodes = vertices[chosen]
    ties = tie_nodes(nodes, away[chosen])  # both ways: each end says where the other should be
    free = np.zeros(len(ties))
    near = away[chosen] < PART * radius
    return Graph(nodes, nearest, weights, ties, nodes[ties[:, 1]], free, near)


def cover(surface: csr_array, radius: float) -> Int[np.ndarray, " nodes"]:
    """Choose vertices so that every vertex has one within a radius along the surface."""
    count = surface.shape[0]
    free, chosen = np.ones(count, bool), []
    nearest = np.full(count, np.inf)
    latest = 0
    while free.any():
        chosen.append(latest)
        away = dijkstra(surface, directed=False, indices=latest, limit=2.5 * radius)
        free &= away > radius
        np.minimum(nearest, away, out=nearest)
        reached = np.where(free & np.isfinite(nearest), nearest, -1.0)
        latest = int(reached.argmax()) if reached.max() > 0 else int(free.argmax())
    return np.array(chosen, np.int64)


def tie_nodes(
    nodes: Float[np.ndarray, "nodes 3"], away: Float[np.ndarray, "nodes nodes"]
) -> Int[np.ndarray, "edges 2"]:
    """Give each node its nearest neighbours along the surface; bridge parts that do not touch.

    Args:
        away: distance along the surface, infinite beyond reach.
    """
    count = len(nodes)
    reach = away + np.where(np.eye(count, dtype=bool), np.inf, 0.0)
    nearest = np.argsort(reach, axis=1)[:, :NEIGHBOURS]
    ties = np.zeros((count, count), bool)
    ties[np.arange(count)[:, None], nearest] = True
    ties &= np.isfinite(reach)
    ties |= ties.T
    parts, part = connected_components(csr_array(ties), directed=False)
    while parts > 1:
        smallest = int(np.bincount(part).argmin())
        inside, outside = np.flatnonzero(part == smallest), np.flatnonzero(part != smallest)
        distance, other = cKDTree(nodes[outside]).query(nodes[inside])
        near = int(distance.argmin())
        first, second = int(inside[near]), int(outside[other[near]])
        around = [around_node(nodes, ties, node) for node in (first, second)]
        ties[np.ix_(*around)] = True
        ties[np.ix_(*around[::-1])] = True
        parts, part = connected_components(csr_array(ties), directed=False)
    return np.argwhere(ties).astype(np.int64)


def around_node(
    nodes: Float[np.ndarray, "nodes 3"], ties: Bool[np.ndarray, "nodes nodes"], node: int
) -> Int[np.ndarray, " few"]:
    """Give a node and the nearest BRIDGE - 1 that it is tied to."""
    tied = np.flatnonzero(ties[node])
    away = np.linalg.norm(nodes[tied] - nodes[node], axis=1)
    return np.concatenate([[node], tied[np.argsort(away)][: BRIDGE - 1]])


def at_rest(graph: Graph) -> Motion:
    """Give the motion that changes nothing."""
    count = len(graph.nodes)
    return Motion(np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3)))


def warp(
    graph: Graph, motion: Motion, points: Points, rows: Int[np.ndarray, " points"] | slice
) -> Points:
    """Move points of the surface, sum_j w_j (R_j (v - g_j) + g_j + T_j) (Eq. 2).

    Args:
        rows: which vertex each point is.
    """
    moved = np.einsum("pkac,pkc->pka", *lever_arms(graph, motion, points, rows))
    moved += (graph.nodes + motion.translations)[graph.influences[rows]]
    return np.einsum("pk,pka->pa", graph.weights[rows], moved)


def lever_arms(
    graph: Graph, motion: Motion, points: Points, rows: Int[np.ndarray, " points"] | slice
) -> tuple[Float[np.ndarray, "points 4 3 3"], Float[np.ndarray, "points 4 3"]]:
    """Give each point's nodes' rotations, and its place seen from those nodes at rest."""
    chosen = graph.influences[rows]
    return motion.rotations[chosen], points[:, None] - graph.nodes[chosen]


def turn_normals(
    graph: Graph, motion: Motion, normals: Points, rows: Int[np.ndarray, " points"] | slice
) -> Points:
    """Turn unit normals of the surface with their nodes."""
    blended = np.einsum(
        "pk,pkac->pac", graph.weights[rows], motion.rotations[graph.influences[rows]]
    )
    turned = np.einsum("pac,pc->pa", blended, normals)
    return turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)


@dataclass(frozen=True, eq=False)
class Wish:
    """Where points of the surface should go: a pull of strength A_p = w (n n^T + share I)."""

    rows: Int[np.ndarray, " pairs"]  # vertex of the surface
    places: Float[np.ndarray, "pairs 3"]
    normals: Float[np.ndarray, "pairs 3"]
    weights: Float[np.ndarray, " pairs"]
    share: float  # of point-to-point beside point-to-plane


def gauss_newton(
    graph: Graph,
    motion: Motion,
    vertices: Points,
    wish: Wish,
    *,
    rigidity: float,
    damping: float,
) -> Motion:
    """Solve one linearised step of Eq. 4 and apply it, no node turning by more than half a radian.

    Args:
        vertices: the surface at rest.
        rigidity: weight of keeping edges between nodes as they are (ARAP).
        damping: added to the diagonal, against nodes that nothing pulls.
    """
    count = len(graph.nodes)
    blocks, right = np.zeros((count, count, 6, 6)), np.zeros((count, 6))
    add_wishes(blocks, right, graph, motion, vertices, wish)
    add_rigidity(blocks, right, graph, motion, rigidity)
    if graph.bends.any():
        add_bends(blocks, right, graph, motion)
    matrix = blocks.transpose(0, 2, 1, 3).reshape(6 * count, 6 * count)
    matrix[np.arange(6 * count), np.arange(6 * count)] += damping
    factor = cho_factor(matrix, lower=False, overwrite_a=True, check_finite=False)
    step = cho_solve(factor, right.ravel(), check_finite=False).reshape(count, 2, 3)
    turn, shift = step[:, 0], step[:, 1]
    turn = turn * min(1.0, 0.5 / max(float(np.abs(turn).max()), 1e-12))
    return Motion(vectors_to_matrices(turn) @ motion.rotations, motion.translations + shift)


def skew(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Give [v]x, so that [v]x w = v x w."""
    matrices = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrices[..., 0, 1], matrices[..., 1, 0] = -z, z
    matrices[..., 0, 2], matrices[..., 2, 0] = y, -y
    matrices[..., 1, 2], matrices[..., 2, 1] = -x, x
    return matrices


def add_wishes(
    blocks: Float[np.ndarray, "nodes nodes 6 6"],
    right: Float[np.ndarray, "nodes 6"],
    graph: Graph,
    motion: Motion,
    vertices: Points,
    wish: Wish,
) -> None:
    """Add, in place, the normal equations of the data term."""
    rotations, arms = lever_arms(graph, motion, vertices[wish.rows], wish.rows)
    chosen, weights = graph.influences[wish.rows], graph.weights[wish.rows]
    arms = np.einsum("pkac,pkc->pka", rotations, arms)
    places = np.einsum("pk,pka->pa", weights, arms + (graph.nodes + motion.translations)[chosen])
    jacobian = np.empty((*chosen.shape, 3, 6))
    jacobian[..., :3] = -skew(arms)
    jacobian[..., 3:] = np.eye(3)
    jacobian *= weights[..., None, None]
    jacobian = jacobian.transpose(0, 2, 1, 3).reshape(len(chosen), 3, -1)
    pull = wish.normals[:, :, None] * wish.normals[:, None] + wish.share * np.eye(3)
    pull *= wish.weights[:, None, None]
    pulled = pull @ jacobian
    residual = wish.places - places
    gradient = np.einsum("pau,pa->pu", pulled, residual)
    add_blocks(blocks, right, chosen, np.swapaxes(jacobian, 1, 2) @ pulled, gradient)


def add_rigidity(
    blocks: Float[np.ndarray, "nodes nodes 6 6"],
    right: Float[np.ndarray, "nodes 6"],
    graph: Graph,
    motion: Motion,
    rigidity: float,
) -> None:
    """Add, in place, the normal equations of E_smooth (Eq. 4): both ends agree about the pivot.

    With the pivot at the other node this is the paper's term; in between it is a ball joint.
    """
    moved = graph.nodes + motion.translations
    arms = graph.pivots[:, None] - graph.nodes[graph.edges]
    arms = np.einsum("ekac,ekc->eka", motion.rotations[graph.edges], arms)
    reached = moved[graph.edges] + arms
    residual = reached[:, 1] - reached[:, 0]
    jacobian = np.zeros((len(arms), 3, 12))
    jacobian[..., :3], jacobian[..., 6:9] = -skew(arms[:, 0]), skew(arms[:, 1])
    jacobian[..., 3:6], jacobian[..., 9:] = np.eye(3), -np.eye(3)
    gradient = rigidity * np.einsum("eau,ea->eu", jacobian, residual)
    own = rigidity * np.swapaxes(jacobian, 1, 2) @ jacobian
    add_blocks(blocks, right, graph.edges, own, gradient)


def add_bends(
    blocks: Float[np.ndarray, "nodes nodes 6 6"],
    right: Float[np.ndarray, "nodes 6"],
    graph: Graph,
    motion: Motion,
) -> None:
    """Add, in place, the cost of nodes that turn against each other."""
    here, there = np.swapaxes(motion.rotations[graph.edges], 0, 1)
    apart = matrices_to_vectors(there @ np.swapaxes(here, 1, 2))
    jacobian = np.zeros((len(apart), 3, 12))
    jacobian[..., :3], jacobian[..., 6:9] = np.eye(3), -np.eye(3)
    gradient = graph.bends[:, None] * np.einsum("eau,ea->eu", jacobian, apart)
    own = graph.bends[:, None, None] * (np.swapaxes(jacobian, 1, 2) @ jacobian)
    add_blocks(blocks, right, graph.edges, own, gradient)


def add_blocks(
    blocks: Float[np.ndarray, "nodes nodes 6 6"],
    right: Float[np.ndarray, "nodes 6"],
    chosen: Int[np.ndarray, "rows few"],
    systems: Float[np.ndarray, "rows unknowns unknowns"],
    values: Float[np.ndarray, "rows unknowns"],
) -> None:
    """Add small systems of a few nodes each to that of all, in place; only its upper half is whole.

    Blocks of the same two nodes are summed first, by a sparse product.
    """
    count, few = len(right), chosen.shape[1]
    right += sum_rows(chosen.ravel(), values.reshape(-1, 6), count)
    first, second = np.triu_indices(few)
    parts = systems.reshape(len(chosen), few, 6, few, 6).transpose(1, 3, 0, 2, 4)[first, second]
    row, column = chosen.T[first], chosen.T[second]
    parts = np.where((row > column)[..., None, None], np.swapaxes(parts, -1, -2), parts)
    cell = np.minimum(row, column) * count + np.maximum(row, column)
    # a node that a row names twice meets itself off the diagonal: both halves count
    parts[(row == column) & (first != second)[:, None]] *= 2.0
    cells, place = np.unique(cell.ravel(), return_inverse=True)
    sums = sum_rows(place, parts.reshape(-1, 36), len(cells)).reshape(-1, 6, 6)
    blocks[cells // count, cells % count] += sums

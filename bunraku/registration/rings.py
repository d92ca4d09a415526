"""A deformation graph along a curve skeleton: each node is a whole ring of the surface.

A figure that is known all round is followed so: the seen half of a limb takes the other with it,
rings are joined by ball joints, and thick parts bend less than thin ones, as beams do.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import diags
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import splu

from bunraku.curves import CurveSkeleton
from bunraku.graphs import adjacency, edge_lengths
from bunraku.meshes import sum_rows
from bunraku.registration.deformation import INFLUENCES, PART, Graph
from bunraku.spectral import laplacian

LEAST_WEIGHT = 0.02  # of a ring on a vertex
BEND = 0.1  # cost of one ring's turn against the next where a limb is THICK
THICK = 0.06  # in half diagonals: a limb's radius


def build_ring_graph(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    curves: CurveSkeleton,
    radius: float,
) -> Graph:
    """Let each node of a curve skeleton carry its ring of a closed surface.

    Args:
        vertices: in units of half the diagonal, as the skeleton's nodes are.
        radius: width over which neighbouring rings blend.
    """
    influences, weights = blend_rings(vertices, faces, curves, radius)
    nodes, edges = curves.nodes, curves.edges
    thick = ring_radii(vertices, curves)[edges].max(axis=1)
    bends = BEND * np.clip((thick / THICK) ** 2, 0.3, 100.0)
    lengths = np.maximum(edge_lengths(nodes, edges), 1e-9)
    away = dijkstra(adjacency(edges, lengths, len(nodes)), directed=False)
    pivots = nodes[edges].mean(axis=1)
    return Graph(nodes, influences, weights, edges, pivots, bends, away < PART * radius)


def blend_rings(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    curves: CurveSkeleton,
    radius: float,
) -> tuple[Int[np.ndarray, "vertices 4"], Float[np.ndarray, "vertices 4"]]:
    """Blur who owns each vertex along the surface (one step of heat): four rings, weights sum to 1.

    Along the surface: a ring never takes part of the limb beside it.
    """
    count = max(len(curves.nodes), INFLUENCES)
    owned = np.eye(count)[curves.owners]
    stiffness, mass = laplacian(vertices, faces)
    blurred = splu((radius**2 * stiffness + diags(mass)).tocsc()).solve(mass[:, None] * owned)
    largest = np.sort(np.argsort(-blurred, axis=1, kind="stable")[:, :INFLUENCES], axis=1)
    weights = np.take_along_axis(blurred, largest, axis=1)
    weights[weights < LEAST_WEIGHT] = 0.0
    weights /= weights.sum(axis=1, keepdims=True)
    return np.where(weights > 0, largest, curves.owners[:, None]), weights


def ring_radii(
    vertices: Float[np.ndarray, "vertices 3"], curves: CurveSkeleton
) -> Float[np.ndarray, " nodes"]:
    """Give the mean distance of each node's vertices; 0 for a node without."""
    count = len(curves.nodes)
    away = np.linalg.norm(vertices - curves.nodes[curves.owners], axis=1)
    owned = np.bincount(curves.owners, minlength=count)
    return sum_rows(curves.owners, away, count) / np.maximum(owned, 1)

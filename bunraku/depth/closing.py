"""Guess the side of a subject that the camera does not see, so that it has a body to compare.

Limbs are taken as about round: the unseen side lies as far behind the seen one as a circle of the
limb's width would. After Igarashi, Matsuoka, Tanaka 1999, "Teddy: a sketching interface for 3D
freeform design"; the guess only serves to match figures, never to measure.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import dijkstra

from bunraku.graphs import adjacency, edge_lengths, mesh_edges
from bunraku.types import Character, Mesh, Skin


def close_performer(
    performer: Character,
    owners: Int[np.ndarray, " vertices"],
    eye: Float[np.ndarray, "3"],
) -> Character:
    """Give a performer seen from one side a closed body; the unseen side moves with the seen one.

    Args:
        performer: its seen side.
        owners: which ring (node of the curve skeleton) each vertex belongs to.
        eye: where the camera stands.
    """
    vertices, faces = performer.mesh.vertices, performer.mesh.faces
    rim = boundary_vertices(faces, len(vertices))
    depth = thickness(vertices, faces, owners, rim)
    away = vertices - eye
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    inner = np.flatnonzero(~rim)
    number = np.arange(len(vertices))
    number[inner] = len(vertices) + np.arange(len(inner))
    behind = vertices[inner] + depth[inner, None] * away[inner]
    closed = np.concatenate([faces, number[faces][:, ::-1]])
    inside = ~rim[faces].all(axis=1)  # a face on the rim alone would meet itself
    closed = closed[np.concatenate([inside, inside])]
    weights = np.concatenate([performer.skin.weights, performer.skin.weights[inner]])
    return Character(
        Mesh(np.concatenate([vertices, behind]), closed),
        performer.skeleton,
        Skin(weights, performer.skin.inverse_bind),
        performer.clips,
    )


def boundary_vertices(
    faces: Int[np.ndarray, "faces 3"], count: int
) -> Bool[np.ndarray, " vertices"]:
    """Mark the vertices on edges that have one face only."""
    ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, times = np.unique(ends, axis=0, return_counts=True)
    rim = np.zeros(count, bool)
    rim[edges[times == 1]] = True
    return rim


def thickness(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    owners: Int[np.ndarray, " vertices"],
    rim: Bool[np.ndarray, " vertices"],
) -> Float[np.ndarray, " vertices"]:
    """Give how far behind each vertex the unseen side is: the chord of a round limb."""
    edges = mesh_edges(faces)
    lengths = np.maximum(edge_lengths(vertices, edges), 1e-12)
    surface = adjacency(edges, lengths, len(vertices))
    inwards = dijkstra(surface, directed=False, indices=np.flatnonzero(rim), min_only=True)
    inwards[~np.isfinite(inwards)] = 0.0
    radius = np.zeros(int(owners.max()) + 1)
    np.maximum.at(radius, owners, inwards)
    own = radius[owners]
    for _ in range(5):  # rings differ; the body does not step from one to the next
        total = np.bincount(edges.ravel(), own[edges[:, ::-1].ravel()], len(vertices))
        own = (own + total) / (1 + np.bincount(edges.ravel(), minlength=len(vertices)))
    own = np.maximum(own, inwards)
    chord: np.ndarray = 2 * np.sqrt(np.maximum(inwards * (2 * own - inwards), 0.0))
    return chord

"""Smooth weights along a surface, keep rigid pieces rigid: a network's answers differ by noise."""

import numpy as np
from jaxtyping import Float

from bunraku.meshes import connected_parts, vertex_areas, weld
from bunraku.spectral import SHIFTS, factorise, laplacian
from bunraku.types import Mesh

STIFF = 0.7  # share of one part from which a loose piece is taken for rigid, chosen in-sample
BODY = 0.5  # share of the figure's area from which a piece is no loose one, but the body


def stiffen(
    weights: Float[np.ndarray, "vertices parts"], mesh: Mesh, *, least: float = STIFF
) -> Float[np.ndarray, "vertices parts"]:
    """Give loose pieces that are nearly all of one part to that part alone.

    A helmet, a block, a shoe of its own hangs on one bone; a sleeve or a body passes from part to
    part, and no part has so much of it. What is most of the figure is no loose piece, and is left.

    Args:
        least: share of a piece's area that its strongest part must have.
    """
    if not len(mesh.faces):
        return weights
    vertices, faces, place = weld(mesh.vertices, mesh.faces)
    piece = connected_parts(faces, len(vertices))[place]
    area = np.maximum(vertex_areas(mesh.vertices, mesh.faces), 1e-12)[:, None]
    total = np.zeros((int(piece.max()) + 1, weights.shape[1]))
    np.add.at(total, piece, area * weights)
    size = total.sum(axis=1)
    alone = np.eye(weights.shape[1])[total.argmax(axis=1)]
    rigid = (total.max(axis=1) > least * size) & (size <= BODY * size.sum())
    return np.where(rigid[piece][:, None], alone[piece], weights)


def diffuse(
    weights: Float[np.ndarray, "vertices parts"], mesh: Mesh, *, reach: float = 0.01
) -> Float[np.ndarray, "vertices parts"]:
    """Let weights spread for one implicit step of heat flow, (M + t L) w' = M w.

    Args:
        reach: how far, as a share of the longest extent; t is its square.

    Returns:
        weights >= 0 whose rows sum to 1; vertices at one place get the same.
    """
    if not len(mesh.faces):
        return weights
    vertices, faces, place = weld(mesh.vertices, mesh.faces)
    count = np.bincount(place, minlength=len(vertices))
    merged = np.stack(
        [np.bincount(place, column, len(vertices)) / count for column in weights.T], axis=1
    )
    size = float(np.ptp(vertices, axis=0).max())
    stiffness, mass = laplacian(vertices / size, faces)
    mass = np.maximum(mass, 1e-12)
    factors, shift = factorise(SHIFTS[0] * reach**2 * stiffness, mass)
    smooth = np.clip(factors.solve(shift * mass[:, None] * merged), 0.0, None)
    return (smooth / np.maximum(smooth.sum(axis=1, keepdims=True), 1e-12))[place]

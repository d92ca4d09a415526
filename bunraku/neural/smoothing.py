"""Smooth weights along a surface: what a network says of near vertices differs by noise."""

import numpy as np
from jaxtyping import Float

from bunraku.meshes import weld
from bunraku.spectral import SHIFTS, factorise, laplacian
from bunraku.types import Mesh


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

"""Carry what is known at a proxy's vertices to the full figure."""

import numpy as np
from jaxtyping import Float, Int

from bunraku import meshes
from bunraku.proxy.building import Proxy


def lift(
    proxy: Proxy, values: Float[np.ndarray, "proxy_vertices *values"]
) -> Float[np.ndarray, "vertices *values"]:
    """Blend values at the proxy's vertices into every vertex of the figure."""
    return meshes.interpolate(values, proxy.corners, proxy.barycentric)


def lift_weights(
    proxy: Proxy,
    weights: Float[np.ndarray, "proxy_vertices joints"],
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
) -> Float[np.ndarray, "vertices joints"]:
    """Carry skinning weights to the figure; vertices at one place get one row."""
    lifted = lift(proxy, weights)
    _, first, place = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    return lifted[first][place.reshape(-1)]

"""Judges of a map: no single one knows a right map, several together know most wrong ones."""

import numpy as np
from jaxtyping import Float

from bunraku.matching.refinement import mapped_coordinates
from bunraku.matching.surfaces import Surface
from bunraku.meshes import signed_volume


def surface_stretch(target: Surface, carried: Float[np.ndarray, "target_vertices 3"]) -> float:
    """Measure how the target's edges change length when carried to the source: 0 keeps them.

    The mean over edges of |length - carried| / (length + carried).
    """
    edges = np.unique(np.sort(target.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    own, mapped = (
        np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        for points in (target.vertices, carried)
    )
    return float((np.abs(own - mapped) / (own + mapped)).mean())


def volume_ratio(
    source: Surface, target: Surface, matrix: Float[np.ndarray, "functions functions"]
) -> float:
    """Compare the signed volume of the carried target with the source's: near 1 if right, below
    0 if left and right are swapped, because then the surface is turned inside out.
    """
    carried = mapped_coordinates(source.basis, target.basis, matrix, source.vertices)
    smooth = mapped_coordinates(
        source.basis, source.basis, np.eye(matrix.shape[1]), source.vertices
    )
    return signed_volume(carried, target.faces) / signed_volume(smooth, source.faces)

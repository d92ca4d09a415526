"""A scan without faces: which way its surface faces, and how much of it each point stands for."""

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.spatial import cKDTree

from bunraku.proxy import solids, voxels

NEIGHBOURS = 12  # around a point, that tell its tangent plane


def spacings(points: Float[np.ndarray, "points 3"], tree: cKDTree) -> Float[np.ndarray, " points"]:
    """Measure the distance from each point to its sixth neighbour."""
    return tree.query(points, k=min(7, len(points)))[0][:, -1]


def oriented_normals(
    points: Float[np.ndarray, "points 3"], tree: cKDTree, spacing: float
) -> Float[np.ndarray, "points 3"]:
    """Fit a plane to each point's neighbours; face it away from the solid that the cloud encloses.

    The solid is what cannot be reached from outside when every point is a ball, with balls as
    large as needed to close the surface.
    """
    _, near = tree.query(points, k=min(NEIGHBOURS, len(points)))
    spokes = points[near] - points[near].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("pki,pkj->pij", spokes, spokes))[1][:, :, 0]
    cells = np.clip(np.ptp(points, axis=0).max() / spacing, 8, 96)
    grid = voxels.grid_around(points, int(cells))
    depth = ndimage.gaussian_filter(enclosed(points, grid).astype(np.float64), 1.5)
    uphill = np.stack([slope[grid.nodes(points)] for slope in np.gradient(depth)], axis=1)
    sides = np.where(np.einsum("pc,pc->p", normals, uphill) > 0, -1.0, 1.0)
    return normals * sides[:, None]


def enclosed(points: Float[np.ndarray, "points 3"], grid: voxels.Grid) -> Bool[np.ndarray, "x y z"]:
    """Fill the shell of a cloud, thickened no more than is needed to enclose nearly all it can."""
    touched = voxels.touched_nodes(points, grid)
    filled = [
        voxels.erode(solids.fill(voxels.dilate(touched, steps)), steps) | touched
        for steps in (1, 2, 3, 4)
    ]
    counts = np.array([solid.sum() for solid in filled])
    return filled[int((counts >= 0.9 * counts.max()).argmax())]

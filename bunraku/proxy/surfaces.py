"""From marked grid nodes back to a surface: signed distance, marching cubes."""

from collections.abc import Callable

import igl
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from bunraku.proxy.solids import cube_corners
from bunraku.proxy.voxels import Grid, dilate, erode
from bunraku.types import Mesh

Distance = Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]]


def signed_distance(
    solid: Bool[np.ndarray, "x y z"],
    distance_to: Distance,
    sheet: Float[np.ndarray, "sheet 3"],
    grid: Grid,
    thickness: float,
) -> Float[np.ndarray, "x y z"]:
    """Measure, in cells, how far each node beside the solid's border is from it; < 0 inside.

    The sign always agrees with `solid`, so that its topology is that of the level set.
    """
    nodes = np.argwhere(dilate(solid) & ~erode(solid))
    points = grid.points(nodes)
    distance = distance_to(points) / grid.cell
    within = solid[tuple(nodes.T)]
    level = np.where(within, -distance, distance)
    if len(sheet):
        from_sheet = cKDTree(sheet).query(points)[0] / grid.cell
        level = np.where(from_sheet < distance + 0.3, from_sheet - thickness / 2, level)
    level = np.where(within, np.clip(level, -1.0, -0.1), np.clip(level, 0.1, 1.0))
    field = np.where(solid, -1.0, 1.0)
    field[tuple(nodes.T)] = level
    return field


def march(field: Float[np.ndarray, "x y z"], grid: Grid) -> Mesh:
    """Triangulate the zero level of a field by marching cubes, on the cells that it crosses."""
    inside = field < 0
    corners = cube_corners(field.shape)
    count = np.sum([inside[corner] for corner in corners], axis=0, dtype=np.uint8)
    crossed = np.argwhere((count > 0) & (count < 8))
    order = np.array(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    )
    cells = np.ravel_multi_index(tuple((crossed[:, None] + order).T), field.shape).T
    used, cells = np.unique(cells, return_inverse=True)
    nodes = np.stack(np.unravel_index(used, field.shape), axis=1)
    vertices, faces, _ = igl.marching_cubes(
        field.ravel()[used], grid.points(nodes), cells.reshape(-1, 8).astype(np.int64), 0.0
    )
    return Mesh(vertices, faces.astype(np.int64))

"""Which nodes of a grid lie inside a figure that may be open, torn, thin or in many parts."""

from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.spatial import cKDTree

from bunraku import meshes

MARGIN = 3  # empty nodes around the figure
SHEET = 0.75  # half the thickness given to a surface without inside, in cells
FACES_AROUND = ndimage.generate_binary_structure(3, 1)
ALL_AROUND = ndimage.generate_binary_structure(3, 3)


@dataclass(frozen=True, eq=False)
class Grid:
    """A regular lattice of nodes around a figure."""

    origin: Float[np.ndarray, "3"]
    cell: float  # metres between neighbouring nodes
    shape: tuple[int, int, int]

    def points(self, nodes: Int[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "nodes 3"]:
        """Place nodes, given by their three indices, in the world."""
        return self.origin + self.cell * nodes


def grid_around(points: Float[np.ndarray, "points 3"], cells: int) -> Grid:
    """Lay a grid over points with this many cells along their longest side."""
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    cell = float(extent.max()) / cells
    counts = np.ceil(extent / cell).astype(int) + 1 + 2 * MARGIN
    return Grid(low - MARGIN * cell, cell, (int(counts[0]), int(counts[1]), int(counts[2])))


def inside_by_winding(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], grid: Grid
) -> Bool[np.ndarray, "x y z"]:
    """Mark the nodes around which the surface winds more than half a time.

    Reference:
        Barill et al. 2018, "Fast winding numbers for soups and clouds".
    """
    nodes = np.indices(grid.shape).reshape(3, -1).T
    winding = igl.fast_winding_number(vertices, faces, grid.points(nodes))
    return (np.abs(winding) > 0.5).reshape(grid.shape)


def sheet_samples(
    samples: Float[np.ndarray, "samples 3"], inside: Bool[np.ndarray, "x y z"], grid: Grid
) -> Float[np.ndarray, "sheet 3"]:
    """Keep the surface samples that no inside node is near: a cape, a skirt, a lone leaf."""
    near = ndimage.binary_dilation(inside, ALL_AROUND)
    node = np.round((samples - grid.origin) / grid.cell).astype(int)
    return samples[~near[tuple(node.T)]]


def thicken(
    inside: Bool[np.ndarray, "x y z"], sheet: Float[np.ndarray, "sheet 3"], grid: Grid
) -> Bool[np.ndarray, "x y z"]:
    """Mark the nodes within half a sheet's thickness of its samples too."""
    if not len(sheet):
        return inside
    touched = np.zeros(grid.shape, bool)
    touched[tuple(np.round((sheet - grid.origin) / grid.cell).astype(int).T)] = True
    nodes = np.argwhere(ndimage.binary_dilation(touched, ALL_AROUND) & ~inside)
    distance, _ = cKDTree(sheet).query(grid.points(nodes))
    solid = inside.copy()
    solid[tuple(nodes[distance < SHEET * grid.cell].T)] = True
    return solid


def bridge(inside: Bool[np.ndarray, "x y z"], *, reach: float = 8.0) -> Bool[np.ndarray, "x y z"]:
    """Tie loose pieces to the largest with one rod each, at their nearest nodes; drop the rest.

    One rod a piece never makes a handle, where closing the gap could make many.

    Args:
        reach: longest rod, in cells; a piece farther away is dropped.
    """
    solid, (pieces, count) = inside.copy(), ndimage.label(inside, FACES_AROUND)
    if count <= 1:
        return solid
    sizes = np.bincount(pieces.ravel())[1:]
    main = pieces == 1 + int(sizes.argmax())
    loose = {int(i) + 1 for i in np.argsort(-sizes, kind="stable")[1:]}
    while loose:
        distance, nearest = ndimage.distance_transform_edt(~main, return_indices=True)
        gaps = ndimage.minimum(distance, pieces, sorted(loose))
        best = int(np.argmin(gaps))
        piece = sorted(loose)[best]
        if gaps[best] > reach:
            break
        members = np.argwhere(pieces == piece)
        start = members[distance[tuple(members.T)].argmin()]
        rod = _rod(start, nearest[(slice(None), *start)], inside.shape)
        main |= (pieces == piece) | rod
        loose.discard(piece)
    return main


def _rod(
    start: Int[np.ndarray, "3"], stop: Int[np.ndarray, "3"], shape: tuple[int, ...]
) -> Bool[np.ndarray, "x y z"]:
    """Mark a straight row of nodes, two thick, from one node to another."""
    steps = 2 * int(np.abs(stop - start).max()) + 1
    line = np.round(np.linspace(start, stop, steps)).astype(int)
    rod = np.zeros(shape, bool)
    rod[tuple(line.T)] = True
    return ndimage.binary_dilation(rod, FACES_AROUND)


def solid_nodes(
    inside: Bool[np.ndarray, "x y z"],
) -> Bool[np.ndarray, "x y z"]:
    """Make one solid of the marked nodes: fill what is enclosed, keep the largest piece."""
    filled = ndimage.binary_fill_holes(bridge(inside), FACES_AROUND)
    pieces, _ = ndimage.label(filled, FACES_AROUND)
    return pieces == 1 + int(np.bincount(pieces.ravel())[1:].argmax())


def signed_distance(
    solid: Bool[np.ndarray, "x y z"],
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    sheet: Float[np.ndarray, "sheet 3"],
    grid: Grid,
) -> Float[np.ndarray, "x y z"]:
    """Measure, in cells, how far each node beside the solid's border is from it; < 0 inside.

    The sign always agrees with `solid`, so that its topology is that of the level set.
    """
    border = ndimage.binary_dilation(solid, ALL_AROUND) & ~ndimage.binary_erosion(solid, ALL_AROUND)
    nodes = np.argwhere(border)
    points = grid.points(nodes)
    distance = meshes.closest_points(points, vertices, faces)[2] / grid.cell
    within = solid[tuple(nodes.T)]
    level = np.where(within, -distance, distance)
    if len(sheet):
        from_sheet = cKDTree(sheet).query(points)[0] / grid.cell
        beside = from_sheet < distance + 0.3
        level = np.where(beside, from_sheet - SHEET, level)
    level = np.where(within, np.clip(level, -1.0, -0.1), np.clip(level, 0.1, 1.0))
    field = np.where(solid, -1.0, 1.0)
    field[tuple(nodes.T)] = level
    return field


def march(
    field: Float[np.ndarray, "x y z"], grid: Grid
) -> tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]:
    """Triangulate the zero level of a field by marching cubes, on the cells that it crosses."""
    number = np.arange(field.size).reshape(field.shape)
    offsets = [
        (0, 0, 0),
        (1, 0, 0),
        (1, 1, 0),
        (0, 1, 0),
        (0, 0, 1),
        (1, 0, 1),
        (1, 1, 1),
        (0, 1, 1),
    ]
    x, y, z = (size - 1 for size in field.shape)
    inside = field < 0
    corners = [inside[a : a + x, b : b + y, c : c + z] for a, b, c in offsets]
    count = np.sum(corners, axis=0, dtype=np.int8)
    crossed = (count > 0) & (count < 8)
    cells = np.stack(
        [number[a : a + x, b : b + y, c : c + z][crossed] for a, b, c in offsets], axis=1
    )
    used, cells = np.unique(cells, return_inverse=True)
    nodes = np.stack(np.unravel_index(used, field.shape), axis=1)
    vertices, faces, _ = igl.marching_cubes(
        field.ravel()[used], grid.points(nodes), cells.reshape(-1, 8), 0.0
    )
    return vertices, faces.astype(np.int64)

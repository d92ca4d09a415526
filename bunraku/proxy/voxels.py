"""Which nodes of a grid lie inside a figure that may be open, torn, thin or in many parts."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

Winding = Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]]
MARGIN = 1  # empty nodes around the figure, at the coarsest level
LEVELS = 3  # halvings of the cell, from the coarsest grid to the one that is marched


@dataclass(frozen=True, eq=False)
class Grid:
    """A regular lattice of nodes around a figure."""

    origin: Float[np.ndarray, "3"]
    cell: float  # metres between neighbouring nodes
    shape: tuple[int, ...]

    def points(self, nodes: Int[np.ndarray, "nodes 3"]) -> Float[np.ndarray, "nodes 3"]:
        """Place nodes, given by their three indices, in the world."""
        return self.origin + self.cell * nodes

    def nodes(self, points: Float[np.ndarray, "points 3"]) -> tuple[np.ndarray, ...]:
        """Find the node nearest to each point, as three arrays of indices."""
        nearest = np.round((points - self.origin) / self.cell).astype(np.int64)
        return tuple(np.clip(nearest, 0, np.array(self.shape) - 1).T)

    def coarser(self, level: int) -> "Grid":
        """Keep every 2^level-th node along each side."""
        step = 2**level
        shape = tuple((size - 1) // step + 1 for size in self.shape)
        return Grid(self.origin, self.cell * step, shape)


def grid_around(
    points: Float[np.ndarray, "points 3"], cells: int, *, most_nodes: int = 3_000_000
) -> Grid:
    """Lay a grid over points with this many cells along their longest side.

    Args:
        most_nodes: bound on the size of the grid; a compact figure gets larger cells.
    """
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    cell = max(
        float(extent.max()) / cells,
        float((extent + extent.max() / 20).prod() / most_nodes) ** (1 / 3),
    )
    step = cell * 2**LEVELS
    counts = np.ceil(extent / step).astype(int) + 2 * MARGIN
    shape = tuple(int(count) * 2**LEVELS + 1 for count in counts)
    return Grid(low - MARGIN * step, cell, shape)


def inside_nodes(
    winding: Winding, samples: Float[np.ndarray, "samples 3"], grid: Grid
) -> Bool[np.ndarray, "x y z"]:
    """Mark the nodes around which the surface winds more than half a time, coarse to fine.

    Finer grids ask only on the surface, within thin plates and where the coarser one sees a border.

    Args:
        winding: the winding number of the surface around points.
        samples: points of the surface, less than a cell apart.

    Reference:
        Barill et al. 2018, "Fast winding numbers for soups and clouds".
    """
    inside = np.zeros(grid.coarser(LEVELS).shape, bool)
    asked = np.ones(inside.shape, bool)
    for level in range(LEVELS, -1, -1):
        coarse = grid.coarser(level)
        if level < LEVELS:
            some, every = _between(inside, np.logical_or), _between(inside, np.logical_and)
            touched = touched_nodes(samples, coarse)
            pinched = [_pinched(touched, axis) for axis in range(3)]  # inside a thin plate
            asked = np.logical_or.reduce([some & ~every, touched, *pinched])
            inside = every
        nodes = np.argwhere(asked)
        inside[tuple(nodes.T)] = np.abs(winding(coarse.points(nodes))) > 0.5
    rim = np.pad(np.zeros(np.array(grid.shape) - 2, bool), 1, constant_values=True)
    return inside & ~rim


def _between(mask: Bool[np.ndarray, "x y z"], join: np.ufunc) -> Bool[np.ndarray, "x2 y2 z2"]:
    """Double a grid; each new node joins the marks of the old nodes around it."""
    for axis in range(3):
        old = np.moveaxis(mask, axis, 0)
        doubled = np.empty((2 * len(old) - 1, *old.shape[1:]), bool)
        doubled[::2], doubled[1::2] = old, join(old[:-1], old[1:])
        mask = np.moveaxis(doubled, 0, axis)
    return np.ascontiguousarray(mask)


def touched_nodes(samples: Float[np.ndarray, "samples 3"], grid: Grid) -> Bool[np.ndarray, "x y z"]:
    """Mark the node nearest to each sample."""
    touched = np.zeros(grid.shape, bool)
    touched[grid.nodes(samples)] = True
    return touched


def dilate(mask: Bool[np.ndarray, "x y z"], steps: int = 1) -> Bool[np.ndarray, "x y z"]:
    """Mark what lies within so many nodes of the marked, diagonals included."""
    for axis in (0, 1, 2) * steps:
        mask = _widened(mask, axis)
    return mask


def erode(mask: Bool[np.ndarray, "x y z"], steps: int = 1) -> Bool[np.ndarray, "x y z"]:
    """Keep what lies at least so many nodes within the marked and the grid, diagonals included."""
    for axis in (0, 1, 2) * steps:
        mask = ~_widened(~mask, axis)
        rim = np.moveaxis(mask, axis, 0)
        rim[0], rim[-1] = False, False
    return mask


def _pinched(mask: Bool[np.ndarray, "x y z"], axis: int) -> Bool[np.ndarray, "x y z"]:
    """Mark what lies between two marked neighbours along one axis."""
    between = np.zeros_like(mask)
    old, new = np.moveaxis(mask, axis, 0), np.moveaxis(between, axis, 0)
    new[1:-1] = old[:-2] & old[2:]
    return between


def _widened(mask: Bool[np.ndarray, "x y z"], axis: int) -> Bool[np.ndarray, "x y z"]:
    """Mark also the two neighbours along one axis."""
    wide = mask.copy()
    old, new = np.moveaxis(mask, axis, 0), np.moveaxis(wide, axis, 0)
    new[1:] |= old[:-1]
    new[:-1] |= old[1:]
    return wide


def sheet_samples(
    samples: Float[np.ndarray, "samples 3"],
    normals: Float[np.ndarray, "samples 3"],
    inside: Bool[np.ndarray, "x y z"],
    grid: Grid,
) -> Float[np.ndarray, "sheet 3"]:
    """Keep the samples with the outside on both sides: a cape, a skirt, a hair card."""
    sides = [inside[grid.nodes(samples + step * grid.cell * normals)] for step in (-1, 0, 1)]
    return samples[~np.any(sides, axis=0)]


def thicken(
    inside: Bool[np.ndarray, "x y z"],
    sheet: Float[np.ndarray, "sheet 3"],
    grid: Grid,
    thickness: float,
) -> Bool[np.ndarray, "x y z"]:
    """Mark the nodes within half a sheet's thickness (in cells) of its samples too."""
    if not len(sheet):
        return inside
    nodes = np.argwhere(dilate(touched_nodes(sheet, grid)) & ~inside)
    distance, _ = cKDTree(sheet).query(grid.points(nodes), distance_upper_bound=2 * grid.cell)
    solid = inside.copy()
    solid[tuple(nodes[distance < thickness / 2 * grid.cell].T)] = True
    return solid

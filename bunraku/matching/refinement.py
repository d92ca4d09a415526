"""From functional maps to point maps and back, and their refinement.

A map `matrix` takes coefficients on the source to coefficients on the target (Eq. 1); a point map
gives each target vertex a source vertex. Equation numbers: Musoni et al. 2021.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from bunraku.spectral import Basis, project

BLOCK = 1024  # queries at a time: a block of distances stays in the processor's cache


def nearest_rows(
    points: Float[np.ndarray, "points dimensions"],
    queries: Float[np.ndarray, "queries dimensions"],
) -> Int[np.ndarray, " queries"]:
    """Find the row of `points` nearest to each query, exactly up to single precision.

    Matrix products beat a tree in the tens of dimensions of a spectral embedding.
    """
    small = np.ascontiguousarray(points.T, np.float32)
    half_squares = (small**2).sum(axis=0) / 2
    rows = np.ascontiguousarray(queries, np.float32)
    found = np.empty(len(rows), np.int64)
    for start in range(0, len(rows), BLOCK):
        closeness = rows[start : start + BLOCK] @ small
        closeness -= half_squares
        found[start : start + BLOCK] = closeness.argmax(axis=1)
    return found


def map_from_points(
    source: Basis,
    target: Basis,
    point_map: Int[np.ndarray, " target_vertices"],
    *,
    size: int,
) -> Float[np.ndarray, "size size"]:
    """Build the functional map of a point map, Phi_S^+ Pi Phi_T (Eq. 2)."""
    return project(target.first(size), source.functions[point_map, :size])


def points_from_map(
    source: Basis, target: Basis, matrix: Float[np.ndarray, "target_functions source_functions"]
) -> Int[np.ndarray, " target_vertices"]:
    """Give each target vertex the source vertex nearest in the spectral embedding.

    Compares rows of Phi_T with rows of Phi_S C: right for maps made from points. A map fitted to
    descriptors is read by `points_from_fitted_map`.
    """
    rows, columns = matrix.shape
    return nearest_rows(source.functions[:, :columns], target.functions[:, :rows] @ matrix)


def points_from_fitted_map(
    source: Basis, target: Basis, matrix: Float[np.ndarray, "target_functions source_functions"]
) -> Int[np.ndarray, " target_vertices"]:
    """Read a map fitted to descriptors: rows of Phi_S against rows of Phi_T C^T.

    Such a map is accurate where it sends source functions, not where its transpose does;
    comparing in the target's functions keeps to the accurate side.
    """
    rows, columns = matrix.shape
    return nearest_rows(source.functions[:, :columns] @ matrix.T, target.functions[:, :rows])


def zoom_out(
    source: Basis,
    target: Basis,
    point_map: Int[np.ndarray, " target_vertices"],
    *,
    sizes: Sequence[int],
) -> tuple[Float[np.ndarray, "size size"], Int[np.ndarray, " target_vertices"]]:
    """Sharpen a point map by growing its functional map, point map and map in turn.

    The map is never made orthogonal: bodies differ in the areas of their parts.

    Args:
        sizes: functions of the map at each step, rising; the last is the size of the result.

    Returns:
        the map of the last size, and the point map read from it.

    Reference:
        Melzi et al. 2019, "ZoomOut: spectral upsampling for efficient shape correspondence".
    """
    for size in sizes:
        matrix = map_from_points(source, target, point_map, size=size)
        point_map = points_from_map(source, target, matrix)
    return matrix, point_map


def mapped_coordinates(
    source: Basis,
    target: Basis,
    matrix: Float[np.ndarray, "target_functions source_functions"],
    vertices: Float[np.ndarray, "source_vertices 3"],
) -> Float[np.ndarray, "target_vertices 3"]:
    """Carry the source's coordinates to the target's vertices as three functions (Eqs. 7-9).

    Returns:
        where each target vertex lies on the source, smoothed to the functions of the map, in
        the units of `vertices`.
    """
    rows, columns = matrix.shape
    return target.functions[:, :rows] @ (matrix @ project(source.first(columns), vertices))

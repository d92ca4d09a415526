"""Polygons cut into triangles: fans where that is right, ears where a polygon bends inwards."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

MOST_CORNERS = 256  # of a polygon whose ears are cut, which takes the cube of them at worst


def triangulate(
    positions: Float[np.ndarray, "vertices 3"],
    corners: Int[np.ndarray, " corners"],
    starts: Int[np.ndarray, " starts"],
) -> tuple[Int[np.ndarray, "faces 3"], Int[np.ndarray, " faces"]]:
    """Cut polygons into triangles, in the polygons' order.

    Args:
        positions: where the vertices are; only concave polygons need it.
        corners: vertices of all polygons, one after the other.
        starts: where each polygon starts in `corners`, and the end of the last one.

    Returns:
        triangles as places in `corners`, and the polygon that each one comes from.
    """
    counts = np.diff(starts)
    if (counts == 3).all():
        return np.arange(starts[0], starts[-1]).reshape(-1, 3), np.arange(len(counts))
    polygon_of = np.repeat(np.arange(len(counts)), counts - 2)
    step = np.arange(len(polygon_of)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    first = starts[:-1][polygon_of]
    faces = np.column_stack([first, first + step + 1, first + step + 2])
    for polygon in _concave(positions[corners], starts, faces, polygon_of):
        if counts[polygon] > MOST_CORNERS:
            continue
        places = np.arange(starts[polygon], starts[polygon + 1])
        inside = slice(*np.searchsorted(polygon_of, [polygon, polygon + 1]))
        faces[inside] = places[_cut_ears(positions[corners[places]])]
    return faces, polygon_of


def _concave(
    points: Float[np.ndarray, "corners 3"],
    starts: Int[np.ndarray, " starts"],
    faces: Int[np.ndarray, "faces 3"],
    polygon_of: Int[np.ndarray, " faces"],
) -> list[int]:
    """Find the polygons whose fan would turn over somewhere."""
    several = np.repeat(np.diff(starts) > 3, np.diff(starts) - 2)
    first, second, third = (points[faces[several, corner]] for corner in range(3))
    normals = np.cross(second - first, third - first)
    owner = polygon_of[several]
    total = np.zeros((len(starts) - 1, 3))
    np.add.at(total, owner, normals)
    against = np.einsum("fc,fc->f", normals, total[owner]) < 0
    return np.unique(owner[against]).tolist()


def _cut_ears(points: Float[np.ndarray, "corners 3"]) -> Int[np.ndarray, "triangles 3"]:
    """Triangulate one simple polygon by cutting ears (Meisters 1975); a fan if none is left."""
    following = np.roll(points, -1, axis=0)
    normal = np.cross(points, following).sum(axis=0)
    axes = np.delete(np.arange(3), np.abs(normal).argmax())
    flat = points[:, axes]
    turn = np.sign(_signed_area(flat)) or 1.0
    left = list(range(len(points)))
    ears: list[list[int]] = []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(flat, left, i, turn)), -1)
        if ear < 0:  # every simple polygon has one, so this one crosses itself
            return np.array([*ears, *([left[0], *pair] for pair in pairwise(left[1:]))])
        ears.append([left[ear - 1], left[ear], left[(ear + 1) % len(left)]])
        del left[ear]
    return np.array([*ears, left])


def _signed_area(flat: Float[np.ndarray, "corners 2"]) -> float:
    """Give twice the area inside a plane polygon, positive if it runs anticlockwise."""
    following = np.roll(flat, -1, axis=0)
    return float((flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]).sum())


def _is_ear(flat: Float[np.ndarray, "corners 2"], left: list[int], i: int, turn: float) -> bool:
    """Tell whether corner i points outwards and no other corner lies in its triangle."""
    triangle = flat[[left[i - 1], left[i], left[(i + 1) % len(left)]]]
    if _signed_area(triangle) * turn <= 0:
        return False
    others = flat[[j for j in left if j not in (left[i - 1], left[i], left[(i + 1) % len(left)])]]
    edges = np.roll(triangle, -1, axis=0) - triangle
    offsets = others[:, None] - triangle
    sides = (edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]) * turn
    return not bool((sides >= 0).all(axis=1).any())

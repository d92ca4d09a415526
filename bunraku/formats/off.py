"""OFF text: vertices, then polygons of any size; colours after the corners are ignored."""

import numpy as np
from jaxtyping import Float, Int

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.formats.headers import check_off
from bunraku.formats.pieces import Piece
from bunraku.formats.polygons import triangulate
from bunraku.types import FormatError


def read_off(path: Location, content: bytes) -> Piece:
    """Read an OFF file; polygons become triangles.

    Raises:
        FormatError: if the header claims more than there is, or a row makes no sense.
    """
    rows = [row.split() for row in check_off(path, content).decode().split("\n")[1:]]
    count = int(rows[0][0])
    positions = _read_vertices(path, rows[1 : count + 1])
    corners, starts = _read_polygons(path, rows[count + 1 :], count)
    faces, _ = triangulate(positions, corners, starts)
    return Piece("", positions, corners[faces])


def _read_vertices(path: Location, rows: list[list[str]]) -> Float[np.ndarray, "vertices 3"]:
    """Read the first three numbers of each vertex row."""
    try:
        return np.array([[float(word) for word in (*row, *"???")[:3]] for row in rows])
    except ValueError:
        wrong = next(i for i, row in enumerate(rows) if not _are_numbers(row[:3]))
        raise FormatError(
            path, f"vertex {wrong}", "wanted three numbers; export it again", code=Code.MESH_NUMBER
        ) from None


def _are_numbers(words: list[str]) -> bool:
    """Tell whether these are three numbers."""
    try:
        return len([float(word) for word in words]) == 3
    except ValueError:
        return False


def _read_polygons(
    path: Location, rows: list[list[str]], count: int
) -> tuple[Int[np.ndarray, " corners"], Int[np.ndarray, " starts"]]:
    """Read how many corners each polygon has, and which."""
    corners: list[int] = []
    starts = [0]
    for number, row in enumerate(rows):
        try:
            polygon = [int(word) for word in row[1 : 1 + int(row[0])]]
            sound = len(polygon) == int(row[0]) >= 3
        except ValueError:
            sound = False
        if not sound or min(polygon) < 0 or max(polygon) >= count:
            shown = " ".join(row)[:50]
            raise FormatError(
                path,
                f"face {number}",
                f"wanted corners from 0 to {count - 1}, got {shown!r}",
                code=Code.MESH_INDEX,
            )
        corners += polygon
        starts.append(len(corners))
    return np.array(corners, np.int64), np.array(starts, np.int64)

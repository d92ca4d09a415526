"""Wavefront OBJ and MTL, line by line, so that an error can name its line.

trimesh reads OBJ too, but skips what it does not understand without a word, reorders vertices, and
knows no line numbers; this reader keeps the file's vertex order, groups and materials. It works
on whole columns of text: only the keyword of a line is looked at one by one.
"""

import logging
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from bunraku.errors import NOTE, WARNING, Code, announce
from bunraku.formats.files import Location
from bunraku.formats.materials import read_materials
from bunraku.formats.pieces import Material, Piece
from bunraku.formats.polygons import triangulate
from bunraku.formats.text import decode_text
from bunraku.types import FormatError

_KEYWORDS = {"v": 1, "vt": 2, "vn": 3, "f": 4, "o": 5, "g": 5, "usemtl": 6, "mtllib": 7}
_POSITION, _UV, _NORMAL, _FACE, _GROUP, _USE, _LIBRARY = range(1, 8)
ABSENT = -1

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class _Lines:
    """The lines of the file, and what each one is."""

    path: Location
    lines: list[str]
    kinds: Int[np.ndarray, " lines"]

    def of(self, kind: int) -> Int[np.ndarray, " found"]:
        """Number the lines of a kind."""
        return np.flatnonzero(self.kinds == kind)

    def trouble(self, line: int, message: str, *, code: Code) -> FormatError:
        """Make the error that names a line and shows it."""
        shown = self.lines[line] if len(self.lines[line]) <= 50 else self.lines[line][:47] + "..."
        return FormatError(self.path, f"line {line + 1}", f"{message}, got {shown!r}", code=code)


def read_obj(path: Location, content: bytes) -> tuple[list[Piece], list[Material]]:
    """Read an OBJ: a piece for each object, group and material that has faces.

    A piece holds the vertices its faces use, in the file's order, doubled only along seams of UVs
    or normals. Vertices that no face uses are dropped.

    Raises:
        FormatError: with the line, if a number, count or index is wrong; if there are no faces.
    """
    text = _Lines(path, *_split(content))
    positions, colours = _read_positions(text)
    uvs, normals = _read_columns(text, _UV, 2), _read_columns(text, _NORMAL, 3)
    if not len(text.of(_FACE)):
        raise FormatError(
            path, "", "has no faces (f lines); export it as a mesh", code=Code.MESH_EMPTY
        )
    corners, starts = _read_faces(text, (len(positions), len(uvs), len(normals)))
    materials = read_materials(path, [text.lines[i] for i in text.of(_LIBRARY)])
    faces, polygon_of = triangulate(positions, corners[:, 0], starts)
    columns = {"uvs": uvs, "normals": normals, "colours": colours}
    labels, part_of = _parts(text, [material.name for material in materials])
    order = np.argsort(part_of[polygon_of], kind="stable")
    part_of_face = part_of[polygon_of][order]
    rows, faces = _unite_corners(np.repeat(part_of_face, 3), corners[faces[order].reshape(-1)])
    columns = {"positions": positions, "colours": colours, "uvs": uvs, "normals": normals}
    numbers = np.arange(len(labels) + 1)
    row_borders = np.searchsorted(rows[:, 0], numbers)
    face_borders = np.searchsorted(part_of_face, numbers)
    pieces = []
    for part, (name, material) in enumerate(labels):
        mine = rows[slice(*row_borders[part : part + 2])]
        inside = faces[slice(*face_borders[part : part + 2])] - row_borders[part]
        pieces.append(Piece(name, faces=inside, material=material, **_gather(columns, mine)))
    return pieces, materials


def _split(content: bytes) -> tuple[list[str], Int[np.ndarray, " lines"]]:
    """Decode the text, join continued lines and find each line's keyword."""
    text = decode_text(content).replace("\r\n", "\n").replace("\r", "\n").replace("\t", " ")
    if "\\\n" in text:  # the joined line comes first, blank ones keep the numbering
        text = re.sub(
            r"(?:[^\n]*\\\n)+[^\n]*",
            lambda run: run[0].replace("\\\n", " ") + "\n" * run[0].count("\n"),
            text,
        )
    lines = [line.strip() for line in text.split("\n")]
    kinds = (_KEYWORDS.get(line.split(" ", 1)[0], 0) for line in lines)
    return lines, np.fromiter(kinds, np.int64, len(lines))


def _numbers(text: _Lines, where: Int[np.ndarray, " found"], rows: list[list[str]]) -> np.ndarray:
    """Turn the words of lines into numbers, all in one column."""
    words = [word for row in rows for word in row]
    try:
        return np.fromiter(map(float, words), np.float64, len(words))
    except ValueError:
        for line, row in zip(where, rows, strict=True):
            if not all(_is_number(word) for word in row):
                raise text.trouble(
                    int(line), "wanted numbers with a decimal point", code=Code.MESH_NUMBER
                ) from None
        raise


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _table(
    text: _Lines, kind: int, sizes: tuple[int, ...], what: str
) -> tuple[Int[np.ndarray, " found"], Int[np.ndarray, " found"], Float[np.ndarray, " numbers"]]:
    """Read the numbers after a keyword: their lines, how many each line has, and all of them."""
    where = text.of(kind)
    rows = [text.lines[i].split("#", 1)[0].split()[1:] for i in where]
    counts = np.fromiter(map(len, rows), np.int64, len(rows))
    wrong = ~np.isin(counts, sizes)
    if wrong.any():
        raise text.trouble(int(where[wrong.argmax()]), f"wanted {what}", code=Code.MESH_NUMBER)
    return where, counts, _numbers(text, where, rows)


def _read_positions(
    text: _Lines,
) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "vertices 3"] | None]:
    """Read the v lines: x y z, perhaps a weight, perhaps red green blue."""
    where, counts, numbers = _table(text, _POSITION, (3, 4, 6, 7, 8), "v x y z")
    starts = np.cumsum(counts) - counts
    positions = numbers[starts[:, None] + np.arange(3)] if len(where) else np.empty((0, 3))
    wrong = ~np.isfinite(positions).all(axis=1)
    if wrong.any():
        raise text.trouble(
            int(where[wrong.argmax()]), "wanted finite coordinates", code=Code.MESH_NONFINITE
        )
    if not (counts >= 6).any():
        return positions, None
    coloured = counts >= 6
    colours = np.ones((len(where), 3))
    first = (starts + np.where(counts == 7, 4, 3))[coloured]
    given = np.nan_to_num(numbers[first[:, None] + np.arange(3)], posinf=0.0)
    colours[coloured] = np.clip(given / (255.0 if given.max() > 1 else 1.0), 0.0, 1.0)
    return positions, colours


def _read_columns(text: _Lines, kind: int, width: int) -> Float[np.ndarray, "rows width"]:
    """Read vt or vn lines; missing numbers count as zero."""
    where, counts, numbers = _table(text, kind, (1, 2, 3, 4), "one to four numbers")
    columns = np.zeros((len(where), width))
    for column in range(width):
        there = counts > column
        columns[there, column] = numbers[(np.cumsum(counts) - counts)[there] + column]
    return np.nan_to_num(columns, posinf=0.0, neginf=0.0)


def _read_faces(
    text: _Lines, sizes: tuple[int, int, int]
) -> tuple[Int[np.ndarray, "corners 3"], Int[np.ndarray, " starts"]]:
    """Read the f lines: position, UV and normal of every corner, and where each polygon starts."""
    where = text.of(_FACE)
    rows = [text.lines[i].split("#", 1)[0].split()[1:] for i in where]
    counts = np.fromiter(map(len, rows), np.int64, len(rows))
    if (counts < 3).any():
        raise text.trouble(
            int(where[(counts < 3).argmax()]),
            "wanted at least three corners",
            code=Code.MESH_CORNERS,
        )
    line_of = np.repeat(where, counts)
    corners = _corner_numbers(text, line_of, [word for row in rows for word in row])
    for column, (kind, what) in enumerate(((_POSITION, "v"), (_UV, "vt"), (_NORMAL, "vn"))):
        index = corners[:, column]
        relative = index < 0
        before = np.searchsorted(text.of(kind), line_of[relative])
        index[relative] += before + 1
        wrong = (index < (column == 0)) | (index > sizes[column]) | (relative & (index < 1))
        if not wrong.any():
            continue
        message = f"wanted {what} indices from 1 to {sizes[column]}"
        trouble = text.trouble(int(line_of[wrong.argmax()]), message, code=Code.MESH_INDEX)
        if column == 0:
            raise trouble
        message = f"{trouble.message}; all {what} are left out"
        level = WARNING if sizes[column] else NOTE
        announce(text.path, message, code=Code.MESH_LEFT_OUT, where=trouble.where, level=level)
        corners[:, column] = 0
    return corners - 1, np.concatenate([[0], np.cumsum(counts)])


def _corner_numbers(
    text: _Lines, line_of: Int[np.ndarray, " corners"], words: list[str]
) -> Int[np.ndarray, "corners 3"]:
    """Split words such as 7/2/5, 7//5, 7/2 and 7; 0 stands for what is not given."""
    slashes = {word.count("/") for word in words}
    if len(slashes) == 1 and max(slashes) <= 2:
        filled = " ".join(words).replace("//", "/0/").replace("/", " ").split()
        width = max(slashes) + 1
        try:
            numbers = np.fromiter(map(int, filled), np.int64, len(words) * width)
            return np.pad(numbers.reshape(-1, width), ((0, 0), (0, 3 - width)))
        except (ValueError, OverflowError):
            logger.debug("corners are written unevenly; they are read one by one")
    corners = np.zeros((len(words), 3), np.int64)
    for place, word in enumerate(words):
        try:
            corners[place] = _corner(word)
        except (ValueError, OverflowError):
            message = "wanted whole numbers such as 7/2/5"
            raise text.trouble(int(line_of[place]), message, code=Code.MESH_NUMBER) from None
    return corners


def _corner(word: str) -> list[int]:
    """Read one corner; what is not given is 0."""
    parts = [int(part or 0) for part in word.split("/")]
    if len(parts) > 3:
        raise ValueError("more than two slashes")
    return parts + [0] * (3 - len(parts))


def _parts(
    text: _Lines, materials: Sequence[str]
) -> tuple[list[tuple[str, int]], Int[np.ndarray, " polygons"]]:
    """Group polygons by object or group and by material.

    Returns:
        name and material of each part, in order of appearance, and the part of each polygon.
    """
    where = text.of(_FACE)
    number = {name: i for i, name in reversed(list(enumerate(materials)))}
    names = {"": 0}
    labels = np.zeros((len(where), 2), np.int64)
    for column, kind in enumerate((_GROUP, _USE)):
        changes = text.of(kind)
        values = ["", *(text.lines[i].partition(" ")[2].strip() for i in changes)]
        if kind == _GROUP:
            numbers = [names.setdefault(value, len(names)) for value in values]
        else:
            numbers = [number.get(value, ABSENT) for value in values]
        labels[:, column] = np.array(numbers)[np.searchsorted(changes, where)]
    found, first, part_of = np.unique(labels, axis=0, return_index=True, return_inverse=True)
    rank = np.empty(len(found), np.int64)
    rank[np.argsort(first)] = np.arange(len(found))
    shown = list(names)
    ordered = [(shown[name], int(material)) for name, material in found[np.argsort(first)]]
    return ordered, rank[part_of.reshape(-1)]


def _unite_corners(
    part_of: Int[np.ndarray, " corners"], corners: Int[np.ndarray, "corners 3"]
) -> tuple[Int[np.ndarray, "rows 4"], Int[np.ndarray, "faces 3"]]:
    """Find the different combinations of part, position, UV and normal, sorted in that order."""
    every = np.column_stack([part_of, corners])
    order = np.lexsort(every.T[::-1])
    new = np.ones(len(every), bool)
    new[1:] = (np.diff(every[order], axis=0) != 0).any(axis=1)
    row_of = np.empty(len(every), np.int64)
    row_of[order] = np.cumsum(new) - 1
    return every[order][new], row_of.reshape(-1, 3)


def _gather(
    columns: dict[str, np.ndarray | None], rows: Int[np.ndarray, "rows 4"]
) -> dict[str, Any]:
    """Look up what each vertex of a piece has; UVs or normals that some lack are left out."""
    place = {"positions": 1, "colours": 1, "uvs": 2, "normals": 3}
    return {
        what: column[rows[:, place[what]]]
        for what, column in columns.items()
        if column is not None and (rows[:, place[what]] != ABSENT).all()
    }

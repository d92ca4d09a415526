"""Wavefront OBJ, so that an error can name its line.

trimesh reads OBJ too, but skips what it does not understand without a word, reorders vertices, and
knows no line numbers; this reader keeps the file's vertex order, groups and materials.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.errors import NOTE, WARNING, Code, announce
from bunraku.formats.files import Location
from bunraku.formats.materials import read_materials
from bunraku.formats.obj_text import (
    FACE,
    GROUP,
    LIBRARY,
    NORMAL,
    POSITION,
    USE,
    UV,
    Lines,
    Words,
    count_slashes,
    gather_words,
    read_damaged,
    split_lines,
)
from bunraku.formats.pieces import Material, Piece
from bunraku.formats.polygons import triangulate
from bunraku.formats.text import parse_numbers
from bunraku.types import FormatError

ABSENT = -1
_LARGEST_KEY = 1 << 62


def read_obj(path: Location, content: bytes) -> tuple[list[Piece], list[Material]]:
    """Read an OBJ: a piece for each object, group and material that has faces.

    A piece holds the vertices its faces use, in the file's order, doubled only along seams of UVs
    or normals. Vertices that no face uses are dropped, damaged or not.

    Raises:
        FormatError: with the line, if a number, count or index is wrong; if there are no faces.
    """
    text = split_lines(path, content)
    positions, damaged, colours = _read_positions(text)
    uvs, normals = _read_columns(text, UV, 2), _read_columns(text, NORMAL, 3)
    corners, starts = _read_faces(text, (len(positions), len(uvs), len(normals)))
    _check_used(text, positions, damaged, used=corners[:, 0])
    materials = read_materials(path, [text.show(int(i)) for i in text.of(LIBRARY)])
    faces, polygon_of = triangulate(positions, corners[:, 0], starts)
    labels, part_of = _parts(text, [material.name for material in materials])
    part_of_face = part_of[polygon_of]
    if len(labels) > 1:
        order = np.argsort(part_of_face, kind="stable")
        part_of_face, faces = part_of_face[order], faces[order]
    rows, faces = unite_corners(np.repeat(part_of_face, 3), corners[faces.reshape(-1)])
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


def _table(
    text: Lines, kind: int, sizes: tuple[int, ...], what: str
) -> tuple[Words, Float[np.ndarray, " numbers"], Bool[np.ndarray, " numbers"] | None]:
    """Read the numbers after a keyword; also which words are none, if any."""
    words = gather_words(text, kind)
    wrong = ~np.isin(words.counts, sizes)
    if wrong.any():
        raise text.trouble(
            int(words.lines[wrong.argmax()]), f"wanted {what}", code=Code.MESH_NUMBER
        )
    numbers = words.numbers(float)
    if numbers is not None:
        return words, numbers, None
    return words, *read_damaged(words)


def _read_positions(
    text: Lines,
) -> tuple[
    Float[np.ndarray, "vertices 3"],
    Bool[np.ndarray, " vertices"],
    Float[np.ndarray, "vertices 3"] | None,
]:
    """Read the v lines: x y z, perhaps a weight, perhaps red green blue; and which are no numbers.

    Coordinates that are no numbers are NaN.
    """
    words, numbers, damaged = _table(text, POSITION, (3, 4, 6, 7, 8), "v x y z")
    counts = words.counts
    starts = np.cumsum(counts) - counts
    columns = starts[:, None] + np.arange(3)
    positions = numbers[columns] if len(counts) else np.empty((0, 3))
    lost = np.zeros(len(counts), bool) if damaged is None else damaged[columns].any(axis=1)
    if not (counts >= 6).any():
        return positions, lost, None
    coloured = counts >= 6
    colours = np.ones((len(counts), 3))
    first = (starts + np.where(counts == 7, 4, 3))[coloured]
    given = np.nan_to_num(numbers[first[:, None] + np.arange(3)], posinf=0.0)
    colours[coloured] = np.clip(given / (255.0 if given.max() > 1 else 1.0), 0.0, 1.0)
    return positions, lost, colours


def _check_used(
    text: Lines,
    positions: Float[np.ndarray, "vertices 3"],
    damaged: Bool[np.ndarray, " vertices"],
    *,
    used: Int[np.ndarray, " corners"],
) -> None:
    """Refuse coordinates that mean nothing, if a face uses them; announce those that none does."""
    wrong = ~np.isfinite(positions).all(axis=1)
    if not wrong.any():
        return
    is_used = np.zeros(len(positions), bool)
    is_used[used] = True
    if (wrong & is_used).any():
        vertex = int((wrong & is_used).argmax())
        line = int(text.of(POSITION)[vertex])
        if damaged[vertex]:
            message = "wanted numbers with a decimal point"
            raise text.trouble(line, message, code=Code.MESH_NUMBER)
        raise text.trouble(line, "wanted finite coordinates", code=Code.MESH_NONFINITE)
    message = f"{wrong.sum()} vertices that no face uses are no numbers; they are left out"
    announce(text.path, message, code=Code.MESH_NUMBER)


def _read_columns(text: Lines, kind: int, width: int) -> Float[np.ndarray, "rows width"]:
    """Read vt or vn lines; missing numbers count as zero."""
    words, numbers, damaged = _table(text, kind, (1, 2, 3, 4), "one to four numbers")
    if damaged is not None:
        line = int(words.line_of[damaged.argmax()])
        raise text.trouble(line, "wanted numbers with a decimal point", code=Code.MESH_NUMBER)
    counts = words.counts
    columns = np.zeros((len(counts), width))
    starts = np.cumsum(counts) - counts
    for column in range(width):
        there = counts > column
        columns[there, column] = numbers[starts[there] + column]
    return np.nan_to_num(columns, posinf=0.0, neginf=0.0)


def _read_faces(
    text: Lines, sizes: tuple[int, int, int]
) -> tuple[Int[np.ndarray, "corners 3"], Int[np.ndarray, " starts"]]:
    """Read the f lines: position, UV and normal of every corner, and where each polygon starts."""
    words = gather_words(text, FACE)
    empty = words.lines[words.counts == 0]
    if len(empty):
        message = f"{len(empty)} f lines name no corner; they are left out"
        announce(text.path, message, code=Code.MESH_CORNERS, where=f"line {empty[0] + 1}")
        text.kinds[empty] = 0
        words = gather_words(text, FACE)
    if not len(words.lines):
        message = "has no faces (f lines); export it as a mesh"
        raise FormatError(text.path, "", message, code=Code.MESH_EMPTY)
    few = words.counts < 3
    if few.any():
        raise text.trouble(
            int(words.lines[few.argmax()]), "wanted at least three corners", code=Code.MESH_CORNERS
        )
    corners = _corner_numbers(text, words)
    for column, (kind, what) in enumerate(((POSITION, "v"), (UV, "vt"), (NORMAL, "vn"))):
        index = corners[:, column]
        relative = index < 0
        if relative.any():
            before = np.searchsorted(text.of(kind), words.line_of[relative])
            index[relative] += before + 1
        wrong = (index < (column == 0)) | (index > sizes[column]) | (relative & (index < 1))
        if not wrong.any():
            continue
        message = f"wanted {what} indices from 1 to {sizes[column]}"
        line = int(words.line_of[wrong.argmax()])
        trouble = text.trouble(line, message, code=Code.MESH_INDEX)
        if column == 0:
            raise trouble
        message = f"{trouble.message}; all {what} are left out"
        level = WARNING if sizes[column] else NOTE
        announce(text.path, message, code=Code.MESH_LEFT_OUT, where=trouble.where, level=level)
        corners[:, column] = 0
    corners -= 1
    return corners, np.concatenate([[0], np.cumsum(words.counts)])


def _corner_numbers(text: Lines, words: Words) -> Int[np.ndarray, "corners 3"]:
    """Split words such as 7/2/5, 7//5, 7/2 and 7; 0 stands for what is not given."""
    corners = np.zeros((len(words.starts), 3), np.int64)
    slashes = count_slashes(words)
    width = int(slashes[0]) + 1
    if width <= 3 and (slashes == slashes[0]).all():
        filled = words.text.replace(b"//", b" 0 ").replace(b"/", b" ")
        numbers = parse_numbers(filled, len(words.starts) * width, np.int64)
        if numbers is not None:
            corners[:, :width] = numbers.reshape(-1, width)
            return corners
    for place, word in enumerate(words.split()):
        try:
            corners[place] = _corner(word)
        except (ValueError, OverflowError):
            message = "wanted whole numbers such as 7/2/5"
            line = int(words.line_of[place])
            raise text.trouble(line, message, code=Code.MESH_NUMBER) from None
    return corners


def _corner(word: bytes) -> list[int]:
    """Read one corner; what is not given is 0."""
    parts = [int(part or 0) for part in word.split(b"/")]
    if len(parts) > 3:
        raise ValueError("more than two slashes")
    return parts + [0] * (3 - len(parts))


def _value(text: Lines, line: int) -> str:
    """Give what stands behind the keyword of a line."""
    _, _, value = text.show(line).replace("\t", " ").partition(" ")
    return value.strip()


def _parts(
    text: Lines, materials: Sequence[str]
) -> tuple[list[tuple[str, int]], Int[np.ndarray, " polygons"]]:
    """Group polygons by object or group and by material.

    Returns:
        name and material of each part, in order of appearance, and the part of each polygon.
    """
    where = text.of(FACE)
    number = {name: i for i, name in reversed(list(enumerate(materials)))}
    names = {"": 0}
    labels = np.zeros((len(where), 2), np.int64)
    for column, kind in enumerate((GROUP, USE)):
        changes = text.of(kind)
        values = ["", *(_value(text, line) for line in changes.tolist())]
        if kind == GROUP:
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


def unite_corners(
    part_of: Int[np.ndarray, " corners"], corners: Int[np.ndarray, "corners 3"]
) -> tuple[Int[np.ndarray, "rows 4"], Int[np.ndarray, "faces 3"]]:
    """Find the different combinations of part, position, UV and normal, sorted in that order."""
    columns = [part_of, *(corners[:, column] - ABSENT for column in range(3))]
    sizes = [int(column.max()) + 1 for column in columns]
    keys = columns[0]
    for column, size in zip(columns[1:], sizes[1:], strict=True):
        if int(keys.max()) * size >= _LARGEST_KEY:  # count the combinations so far anew
            keys = np.unique(keys, return_inverse=True)[1]
        keys = keys * size + column
    first, row_of = _number_keys(keys)
    rows = np.column_stack([column[first] for column in columns])
    rows[:, 1:] += ABSENT
    return rows, row_of.reshape(-1, 3)


def _number_keys(
    keys: Int[np.ndarray, " keys"],
) -> tuple[Int[np.ndarray, " different"], Int[np.ndarray, " keys"]]:
    """Number keys by size: where the first of each is, and the number of every one."""
    span = int(keys.max()) + 1
    if span > 4 * len(keys):
        _, first, number_of = np.unique(keys, return_index=True, return_inverse=True)
        return first, number_of
    place = np.full(span, -1)
    place[keys[::-1]] = np.arange(len(keys))[::-1]
    first = place[place >= 0]
    place[place >= 0] = np.arange(len(first))
    return first, place[keys]


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

"""OFF text: vertices, then polygons of any size; colours after the corners are ignored."""

import re
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.errors import Code, announce
from bunraku.formats.files import Location
from bunraku.formats.pieces import Piece
from bunraku.formats.polygons import triangulate
from bunraku.formats.text import UTF16_MARKS, decode_text, find_words, parse_numbers
from bunraku.types import FormatError

_KEYWORD = re.compile(rb"\s*((?:ST)?C?N?4?n?)OFF\b[ \t]*(BINARY)?", re.IGNORECASE)
_COUNTS = re.compile(rb"\s*([^\n]*)\n?")


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of words, one behind the other."""

    text: bytes
    counts: Int[np.ndarray, " rows"]  # words in each

    def numbers(self, kind: type) -> np.ndarray | None:
        """Read all words as numbers; nothing if one is none."""
        return parse_numbers(self.text, int(self.counts.sum()), kind)

    def split(self) -> list[list[str]]:
        """Give the words of each row."""
        lines = self.text.decode("utf-8", "replace").split("\n")
        return [words for line in lines if (words := line.split())]


def read_off(path: Location, content: bytes) -> Piece:
    """Read an OFF file; polygons become triangles.

    Raises:
        FormatError: if the header claims more than there is, or a row makes no sense.
    """
    vertices, polygons = _read_rows(path, content)
    positions = _read_vertices(path, vertices)
    corners, starts = _read_polygons(path, polygons, len(positions))
    faces, _ = triangulate(positions, corners, starts)
    return Piece("", positions, corners[faces])


def _read_rows(path: Location, content: bytes) -> tuple[Rows, Rows]:
    """Find the rows of vertices and of polygons that the header counts."""
    if content[:2] in UTF16_MARKS:
        content = decode_text(content).encode()
    text = content.removeprefix(b"\xef\xbb\xbf").replace(b"\r", b"\n")
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", b"", text)
    keyword = _KEYWORD.match(text)
    if not keyword or keyword[2] or b"4" in keyword[1] or b"n" in keyword[1]:
        message = "wanted an ASCII OFF of three dimensions; convert it"
        raise FormatError(path, "line 1", message, code=Code.MESH_HEADER)
    line = _COUNTS.match(text, keyword.end())
    words = line[1].split() if line else []
    if line is None or len(words) < 2 or not all(word.isdigit() for word in words[:2]):
        shown = b" ".join(words).decode("utf-8", "replace")[:50]
        message = f"wanted vertex and face counts, got {shown!r}"
        raise FormatError(path, "counts", message, code=Code.MESH_HEADER)
    vertices, faces = int(words[0][:18]), int(words[1][:18])
    body = text[line.end() :]
    starts, counts = find_words(body + b"\n")
    counts = counts[counts > 0]
    if vertices + faces > len(counts):
        message = f"claim {vertices + faces} rows, the file has {len(counts)}; "
        raise FormatError(
            path, "counts", f"{message}export or download it again", code=Code.MESH_COUNT
        )
    if not vertices or not faces:
        raise FormatError(path, "counts", "has no faces; export it as a mesh", code=Code.MESH_EMPTY)
    if b"C" in keyword[1].upper() and counts[0] <= 3:
        announce(path, "says colours and has none", code=Code.MESH_LEFT_OUT, where="vertex 0")
    places = np.append(starts, len(body))
    middle = places[counts[:vertices].sum()]
    end = places[counts[: vertices + faces].sum()]
    polygons = Rows(body[middle:end], counts[vertices : vertices + faces])
    return Rows(body[:middle], counts[:vertices]), polygons


def _read_vertices(path: Location, rows: Rows) -> Float[np.ndarray, "vertices 3"]:
    """Read the first three numbers of each vertex row."""
    numbers = rows.numbers(float) if rows.counts.min() >= 3 else None
    if numbers is not None:
        first = np.cumsum(rows.counts) - rows.counts
        return numbers[first[:, None] + np.arange(3)]
    words = rows.split()
    try:
        return np.array([[float(word) for word in (*row, *"???")[:3]] for row in words])
    except ValueError:
        wrong = next(i for i, row in enumerate(words) if not _are_numbers(row[:3]))
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
    path: Location, rows: Rows, count: int
) -> tuple[Int[np.ndarray, " corners"], Int[np.ndarray, " starts"]]:
    """Read how many corners each polygon has, and which."""
    numbers = rows.numbers(np.int64)
    if numbers is not None:
        first = np.cumsum(rows.counts) - rows.counts
        sizes = numbers[first]
        if ((sizes >= 3) & (sizes < rows.counts)).all():
            starts = np.concatenate([[0], np.cumsum(sizes)])
            within = np.arange(starts[-1]) - np.repeat(starts[:-1], sizes)
            corners = numbers[np.repeat(first + 1, sizes) + within]
            if corners.min() >= 0 and corners.max() < count:
                return corners, starts
    return _read_one_by_one(path, rows, count)


def _read_one_by_one(
    path: Location, rows: Rows, count: int
) -> tuple[Int[np.ndarray, " corners"], Int[np.ndarray, " starts"]]:
    """Read polygons behind which other words than integers stand, or name the first damaged one."""
    corners: list[int] = []
    starts = [0]
    for number, row in enumerate(rows.split()):
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

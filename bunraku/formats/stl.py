"""STL, binary or text: every solid is a piece; corners at one position become one vertex."""

import re
from collections.abc import Iterator
from itertools import islice

import numpy as np
from jaxtyping import Float, Int, UInt8

from bunraku import limits
from bunraku.errors import Code, announce
from bunraku.formats.files import Location
from bunraku.formats.obj_text import Lines, gather_words
from bunraku.formats.pieces import Piece
from bunraku.formats.text import NEWLINE, SPACE, UTF8_MARK, UTF16_MARKS, decode_text
from bunraku.types import FormatError

UNCOUNTED = (0, 0xFFFFFFFF)
RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = 84  # bytes before the first record
MIXERS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)
CHUNK = 1 << 25  # bytes of text that are looked at together
VERTEX, SOLID = b"vertex", b"solid"
_AGAIN = "export or download it again"
_SOLID = re.compile(rb"[ \t]*(end)?solid\b[ \t]*([^\n]*)", re.IGNORECASE)


def read_stl(path: Location, content: bytes) -> list[Piece]:
    """Read an STL: a piece for each solid that has triangles.

    Raises:
        FormatError: if a binary file has not the triangles that it claims, or a vertex line of a
            text is no vertex.
    """
    content = check_stl(path, _drop_mark(content))
    count = int.from_bytes(content[80:HEADER], "little")
    if len(content) == HEADER + RECORD.itemsize * count:
        _check_count(path, 3 * count)
        corners = np.frombuffer(content, RECORD, offset=HEADER)["corners"]
        with np.errstate(invalid="ignore"):  # signalling NaN: told as not finite further on
            return [_piece("", corners.reshape(-1, 3).astype(np.float64))]
    return list(_read_text(path, content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")))


def _drop_mark(content: bytes) -> bytes:
    """Give a text that begins with a mark of Unicode as UTF-8 without it."""
    count = int.from_bytes(content[80:HEADER], "little")
    if len(content) == HEADER + RECORD.itemsize * count:
        return content  # binary, whatever its header says
    if content[:2] in UTF16_MARKS:
        return decode_text(content).encode()
    return content.removeprefix(UTF8_MARK)


def _check_count(path: Location, corners: int) -> None:
    """Refuse more corners than a closed surface has of as many vertices as are read."""
    if corners > 6 * limits.VERTICES:
        message = f"has more than {2 * limits.VERTICES} triangles; decimate it"
        raise FormatError(path, "", message, code=Code.LIMIT_VERTICES)


def _piece(name: str, corners: Float[np.ndarray, "corners 3"]) -> Piece:
    """Make a piece of corners, three a triangle; those that are equal to the last bit are one."""
    bits = np.ascontiguousarray(corners + 0.0).view(np.uint64)  # + 0.0: there is one zero only
    keys = ((bits ^ (bits >> np.uint64(32))) * MIXERS).sum(axis=1)
    _, first, key_of = np.unique(keys, return_index=True, return_inverse=True)
    if (bits[first[key_of]] != bits).any():  # two positions with one key: as good as never
        return Piece(name, corners, np.arange(len(corners)).reshape(-1, 3))
    order = np.argsort(first)
    place_of = np.empty_like(order)
    place_of[order] = np.arange(len(order))
    return Piece(name, corners[first[order]], place_of[key_of].reshape(-1, 3))


def _read_text(path: Location, text: bytes) -> Iterator[Piece]:
    """Read the solids of a text."""
    marks = list(islice(_find_solids(text), 2 * limits.PIECES + 1))
    if len(marks) > 2 * limits.PIECES:
        message = f"has more than {limits.PIECES} solids; join them"
        raise FormatError(path, "", message, code=Code.LIMIT_TOTAL)
    borders, count = [*(mark.start() for mark in marks), len(text)], 0
    for mark, end in zip(marks, borders[1:], strict=True):
        parts = [np.zeros((0, 3))]
        for start, stop in () if mark[1] else _cut(text, mark.end(), end):
            parts.append(_read_block(path, text, start, stop))
            count += len(parts[-1])
            _check_count(path, count)
        positions = np.concatenate(parts)
        if len(positions) % 3:
            message = f"{len(positions)} vertices are no whole triangles; {_AGAIN}"
            raise FormatError(path, _line_at(text, mark.start()), message, code=Code.MESH_DAMAGED)
        if len(positions):
            yield _piece(decode_text(mark[2]).strip(), positions)
    if not count and any(b" vertex " in mark[2].lower() for mark in marks):
        message = "has no line breaks between its facets; export it with a vertex a line"
        raise FormatError(path, "line 1", message, code=Code.MESH_DAMAGED)
    if not marks or not marks[-1][1]:
        message = "ends without endsolid: some of it may be missing"
        announce(path, message, code=Code.MESH_COUNT, where=_line_at(text, len(text)))


def _find_solids(text: bytes) -> Iterator[re.Match[bytes]]:
    """Find the lines that begin or end a solid; far quicker than by the pattern alone."""
    for start, stop in _cut(text, 0, len(text)):
        letters = np.frombuffer(text, np.uint8, stop - start, start)
        lines = np.append(0, np.flatnonzero(letters == NEWLINE) + 1)
        line_of = np.searchsorted(lines, _find_word(letters, SOLID), side="right") - 1
        for line in lines[np.unique(line_of)].tolist():
            if mark := _SOLID.match(text, start + line):
                yield mark


def _cut(text: bytes, start: int, end: int) -> Iterator[tuple[int, int]]:
    """Cut text into blocks of whole lines: where each begins and ends."""
    while start < end:
        stop = text.find(b"\n", min(start + CHUNK, end), end)
        stop = end if stop < 0 else stop + 1
        yield start, stop
        start = stop


def _find_word(letters: UInt8[np.ndarray, " bytes"], word: bytes) -> Int[np.ndarray, " found"]:
    """Find where a word stands, in small or large letters."""
    found = np.flatnonzero((letters[: len(letters) - len(word) + 1] | SPACE) == word[0])
    for place, letter in enumerate(word[1:], start=1):
        found = found[(letters[found + place] | SPACE) == letter]
    return found


def _line_at(text: bytes, place: int) -> str:
    """Name the line of a byte."""
    count = text.count(b"\n", 0, place)
    return f"line {count + 1}"


def _read_block(
    path: Location, text: bytes, start: int, stop: int
) -> Float[np.ndarray, "vertices 3"]:
    """Read the vertex lines of a block of whole lines."""
    letters = np.frombuffer(text, np.uint8, stop - start, start)
    found = _find_word(letters[:-1], VERTEX)
    found = found[letters[found + len(VERTEX)] <= SPACE]
    found = found[(found == 0) | (letters[found - 1] <= SPACE)]
    newlines = np.append(np.flatnonzero(letters == NEWLINE), len(letters))
    lines, first = np.unique(np.searchsorted(newlines, found), return_index=True)
    found, ends = found[first], newlines[lines]  # a second one in a line is a word too many
    kinds = np.ones(len(found), np.int8)
    words = gather_words(Lines(path, letters, found, found + len(VERTEX), ends, kinds), 1)
    numbers = words.numbers(float) if (words.counts == 3).all() else None
    if numbers is not None:
        return numbers.reshape(-1, 3)
    return _read_rows(path, text, start + found, start + ends)


def _read_rows(path: Location, text: bytes, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Read vertex lines one by one, and name the first that is none."""
    rows = []
    for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
        line = decode_text(text[start:end]).strip()
        try:
            x, y, z = map(float, line.split()[1:])
        except ValueError:
            message = (
                f"wanted vertex x y z on a line of its own, got {line[:50]!r}; export it again"
            )
            raise FormatError(path, _line_at(text, start), message, code=Code.MESH_NUMBER) from None
        rows.append((x, y, z))
    return np.array(rows)


def check_stl(path: Location, content: bytes) -> bytes:
    """Raise a FormatError unless an STL file is text, or has as many triangles as it claims.

    Returns:
        the file, with its triangles counted if the header left them open, and without a tail.
    """
    count = int.from_bytes(content[80:84], "little")
    is_text = re.match(rb"\s*solid\b", content, re.IGNORECASE) and b"\0" not in content[:512]
    tail = len(content) - 84 - 50 * count
    if not is_text and count in UNCOUNTED and len(content) > 84 and len(content) % 50 == 34:
        count = (len(content) - 84) // 50  # those who write as they go leave the count as it was
        message = f"the header does not count the triangles; all {count} are read"
        announce(path, message, code=Code.MESH_COUNT, where="header")
        content = content[:80] + count.to_bytes(4, "little") + content[84:]
    elif not is_text and count and tail > 0:
        message = f"{tail} bytes follow the {count} triangles of the header; they are left out"
        announce(path, message, code=Code.MESH_COUNT, where="header")
        content = content[: HEADER + RECORD.itemsize * count]
    if len(content) >= 84 and len(content) == HEADER + RECORD.itemsize * count:
        if not count:
            raise FormatError(
                path,
                "header",
                "claims 0 triangles; export it again with geometry",
                code=Code.MESH_EMPTY,
            )
        return content
    if not is_text:
        raise FormatError(
            path,
            "header",
            f"claims {count} triangles, the file has bytes for {max(len(content) - 84, 0) / 50:g}; "
            f"{_AGAIN}",
            code=Code.MESH_COUNT,
        )
    return content

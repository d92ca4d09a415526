"""A PLY written as text, rewritten as binary: its rows are read at once, and one reader follows."""

from collections.abc import Iterator

import numpy as np

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.formats.headers import PLY_SIZES, PlyElement, find_ply_body, read_ply_elements
from bunraku.formats.text import decode_text, find_words, parse_numbers
from bunraku.types import FormatError

_LETTERS = {"c": "i", "s": "i", "i": "i", "u": "u", "f": "f", "d": "f"}
TEXT, BINARY = b"format ascii 1.0", b"format binary_little_endian 1.0"


def rewrite_as_binary(path: Location, content: bytes) -> bytes:
    """Give a text PLY as the binary PLY of the same header.

    Args:
        path: the file, for messages.
        content: with a header that `check_ply` found sound.

    Returns:
        the same elements in binary; `content` itself if it is binary; or still text, without
        blank lines and what nobody asked for, if a row has more words than its element says, a
        number is none of its property's type, or polygons are of several sizes.

    Raises:
        FormatError: if there are fewer rows than the header counts, or a row has fewer numbers
            than its element says.
    """
    body = find_ply_body(path, content)
    header = content[:body]
    if TEXT not in header:
        return content
    elements = read_ply_elements(path, header.decode("utf-8", "replace").splitlines())
    text = content[body:].replace(b"\r", b"\n") + b"\n"
    starts, counts = find_words(text)
    counts = counts[counts > 0]
    _check_count(path, elements, len(counts))
    places, row, parts = np.append(starts, len(text)), 0, [header.replace(TEXT, BINARY, 1)]
    for element in elements:
        widths = counts[row : row + element.count]
        first, last = (places[counts[:rows].sum()] for rows in (row, row + element.count))
        records = _read_rows(element, text[first:last], widths)
        if records is None:
            return header + "\n".join(_check_rows(path, elements, text)).encode() + b"\n"
        parts.append(records.tobytes())
        row += element.count
    return b"".join(parts)


def _read_rows(element: PlyElement, text: bytes, widths: np.ndarray) -> np.ndarray | None:
    """Read the rows of an element as records; nothing if they do not all fit."""
    if not element.count:
        return np.zeros(0, np.uint8)
    if len(widths) < element.count or (widths != widths[:1]).any():
        return None
    kinds, width = _kinds_of_row(element, int(widths[0])), int(widths[0])
    whole = all(kind.kind != "f" for kind in kinds)
    numbers = parse_numbers(text, element.count * width, np.int64 if whole else float)
    if numbers is None or len(kinds) != width:
        return None
    table = numbers.reshape(-1, width)
    records = np.empty(element.count, [(f"{place}", kind) for place, kind in enumerate(kinds)])
    fits = not element.lists or bool((table[:, 0] == width - 1).all())
    for place, kind in enumerate(kinds):
        with np.errstate(all="ignore"):
            records[f"{place}"] = table[:, place]
        fits &= kind.kind == "f" or bool((records[f"{place}"] == table[:, place]).all())
    return records if fits else None


def _check_count(path: Location, elements: list[PlyElement], count: int) -> None:
    """Raise a FormatError if a text has fewer rows than its header counts."""
    for element in elements:
        if element.count > count:
            message = f"the header counts {element.count} rows, the file has {count}; give one row"
            raise FormatError(
                path,
                f"element {element.name}",
                f"{message} a line, or export or download it again",
                code=Code.MESH_COUNT,
            )
        count -= element.count


def _check_rows(path: Location, elements: list[PlyElement], text: bytes) -> Iterator[str]:
    """Give the rows as text, or name the first that misses numbers."""
    lines = decode_text(text).split("\n")
    rows = (words for line in lines if (words := line.split()))
    for element in elements:
        for number, words in zip(range(element.count), rows, strict=False):
            width = _find_width(element, words)
            if not width:
                shown = " ".join(words)[:50]
                message = f"wanted a number for each property, one row a line, got {shown!r}"
                raise FormatError(
                    path,
                    f"{element.name} {number}",
                    f"{message}; export it again",
                    code=Code.MESH_COUNT,
                )
            yield " ".join(words[:width])


def _find_width(element: PlyElement, words: list[str]) -> int:
    """Count the words that a row needs; 0 if they are not there, or no numbers."""
    width, first, lists = 0, 0, {place for place, *_ in element.lists}
    try:
        for kind in element.kinds:
            more = int(float(words[width])) if first in lists else 0
            width, first = width + 1 + more, first + PLY_SIZES[kind]
            if more < 0 or width > len(words):
                return 0
        for word in words[:width]:
            float(word)
    except (LookupError, OverflowError, ValueError):
        return 0
    return width


def _kinds_of_row(element: PlyElement, width: int) -> list[np.dtype]:
    """Give the types of the words of a row of so many; too few or many if it has other words."""
    kinds = [_kind(name) for name in element.kinds]
    if not element.lists:
        return kinds
    return kinds + [_kind(element.lists[0][2])] * (width - 1) if len(kinds) == 1 else []


def _kind(name: str) -> np.dtype:
    """Give the NumPy type of a PLY type, such as uchar or float32."""
    return np.dtype(f"<{_LETTERS[name[0]]}{PLY_SIZES[name]}")

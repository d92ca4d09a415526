"""A PLY written as text, rewritten as binary: its rows are read at once, and one reader follows."""

import numpy as np

from bunraku.formats.files import Location
from bunraku.formats.headers import PLY_SIZES, PlyElement, find_ply_body, read_ply_elements
from bunraku.formats.text import find_words, parse_numbers

_LETTERS = {"c": "i", "s": "i", "i": "i", "u": "u", "f": "f", "d": "f"}
TEXT, BINARY = b"format ascii 1.0", b"format binary_little_endian 1.0"


def rewrite_as_binary(path: Location, content: bytes) -> bytes:
    """Give a text PLY as the binary PLY of the same header.

    Args:
        path: the file, for messages.
        content: with a header that `check_ply` found sound.

    Returns:
        the same elements in binary; or `content` itself, if it is binary, a row has another
        number of words than its element says, a word is no number of its property's type, or
        polygons are of several sizes.
    """
    body = find_ply_body(path, content)
    header = content[:body]
    if TEXT not in header:
        return content
    elements = read_ply_elements(path, header.decode("utf-8", "replace").splitlines())
    text = content[body:].replace(b"\r", b"\n") + b"\n"
    starts, counts = find_words(text)
    counts = counts[counts > 0]
    places, row, parts = np.append(starts, len(text)), 0, [header.replace(TEXT, BINARY, 1)]
    for element in elements:
        widths = counts[row : row + element.count]
        first, last = (places[counts[:rows].sum()] for rows in (row, row + element.count))
        records = _read_rows(element, text[first:last], widths)
        if records is None:
            return content
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


def _kinds_of_row(element: PlyElement, width: int) -> list[np.dtype]:
    """Give the types of the words of a row of so many; too few or many if it has other words."""
    kinds = [_kind(name) for name in element.kinds]
    if not element.lists:
        return kinds
    return kinds + [_kind(element.lists[0][2])] * (width - 1) if len(kinds) == 1 else []


def _kind(name: str) -> np.dtype:
    """Give the NumPy type of a PLY type, such as uchar or float32."""
    return np.dtype(f"<{_LETTERS[name[0]]}{PLY_SIZES[name]}")

"""Polygons of different sizes in binary PLY, as modelling programs write quads and triangles."""

import re
from typing import Literal

import numpy as np
from jaxtyping import Int

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.formats.headers import PLY_SIZES, PlyElement, find_ply_body, read_ply_elements
from bunraku.types import FormatError

_KINDS = {1: "i1", 2: "i2", 4: "i4", 8: "i8"}

Polygons = tuple[Int[np.ndarray, " corners"], Int[np.ndarray, " starts"]]


def split_polygons(path: Location, content: bytes) -> tuple[bytes, Polygons | None]:
    """Take the faces out of a binary PLY whose polygons are not all of one size.

    Args:
        path: the file, for messages.
        content: with a header that `check_ply` found sound.

    Returns:
        a PLY of the vertices alone, and the corners of all polygons with where each one starts;
        for any other PLY the content as it was, and nothing.

    Raises:
        FormatError: if the faces reach beyond the end of the file.
    """
    body = find_ply_body(path, content)
    lines = content[:body].decode("utf-8", "replace").splitlines()
    elements = read_ply_elements(path, lines)
    names = [element.name for element in elements]
    is_plain = names[:2] == ["vertex", "face"] and not elements[0].lists
    if not is_plain or b"binary" not in content[:body] or len(elements[1].lists) != 1:
        return content, None
    order = ">" if b"binary_big_endian" in content[:body] else "<"
    first = body + elements[0].count * elements[0].row_bytes
    places, counts = _walk(path, content, first, elements[1])
    if (counts == counts[:1]).all():
        return content, None
    width = PLY_SIZES[elements[1].lists[0][2]]
    starts = np.concatenate([[0], np.cumsum(counts)])
    within = np.arange(starts[-1]) - np.repeat(starts[:-1], counts)
    bytes_of = (np.repeat(places, counts) + within * width)[:, None] + np.arange(width)
    corners = np.frombuffer(content, np.uint8)[bytes_of].view(order + _KINDS[width]).reshape(-1)
    cut = re.sub(rb"element face.*?(?=end_header)", b"", content[:body], flags=re.DOTALL)
    return cut + content[body:first], (corners.astype(np.int64), starts)


def _walk(
    path: Location, content: bytes, first: int, face: PlyElement
) -> tuple[Int[np.ndarray, " faces"], Int[np.ndarray, " faces"]]:
    """Step through the faces, each as long as its own count says: where corners start, how many."""
    place_in_row, count_kind, corner_kind = face.lists[0]
    wide, width = PLY_SIZES[count_kind], PLY_SIZES[corner_kind]
    rest = face.row_bytes - wide
    order: Literal["big", "little"] = (
        "big" if b"binary_big_endian" in content[: find_ply_body(path, content)] else "little"
    )
    places, counts = np.empty(face.count, np.int64), np.empty(face.count, np.int64)
    at = first
    for number in range(face.count):
        start = at + place_in_row
        count = int.from_bytes(content[start : start + wide], order)
        at += wide + rest + count * width
        if at > len(content) or count < 3:
            raise FormatError(
                path,
                f"face {number}",
                f"has {count} corners where the file ends; export it again",
                code=Code.MESH_COUNT,
            )
        places[number], counts[number] = start + wide, count
    return places, counts

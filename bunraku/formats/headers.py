"""What the header of a PLY claims, checked against the bytes that are there."""

import re
from dataclasses import dataclass, field

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.types import FormatError

PLY_SIZES = {
    **{name: 1 for name in ("char", "uchar", "int8", "uint8")},
    **{name: 2 for name in ("short", "ushort", "int16", "uint16", "float16")},
    **{name: 4 for name in ("int", "uint", "int32", "uint32", "float", "float32")},
    **{name: 8 for name in ("int64", "uint64", "double", "float64")},
}
_LARGEST_HEADER = 1 << 16
_AGAIN = "export or download it again"


@dataclass
class PlyElement:
    """An element of a PLY header: how many rows, and at least how many bytes each takes."""

    name: str
    count: int
    properties: list[str] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)  # of each property; of a list, its count's
    row_bytes: int = 0
    lists: list[tuple[int, str, str]] = field(default_factory=list)  # place in the row, types


def check_ply(path: Location, content: bytes) -> bytes:
    """Raise a FormatError unless a PLY header is sound and its counts fit into the file.

    Returns:
        the file; with line feeds in its header, if that had carriage returns alone.
    """
    body = find_ply_body(path, content)
    if b"\n" not in content[:body]:
        content = content[:body].replace(b"\r", b"\n") + content[body:]
    lines = content[:body].decode("utf-8", "replace").splitlines()
    elements = read_ply_elements(path, lines)
    encoding, version = [
        next((line.split()[i : i + 1] for line in lines if line.startswith("format")), [])
        for i in (1, 2)
    ]
    if version != ["1.0"]:
        message = f"has PLY version {' '.join(version)[:20]!r}; only 1.0 is read, export it again"
        raise FormatError(path, "header", message, code=Code.MESH_HEADER)
    if encoding not in (["ascii"], ["binary_little_endian"], ["binary_big_endian"]):
        raise FormatError(
            path,
            "header",
            f"has format {encoding}, wanted ascii or binary_*_endian",
            code=Code.MESH_HEADER,
        )
    room = len(content) - body
    for element in elements:
        smallest = 2 * len(element.properties) if encoding == ["ascii"] else element.row_bytes
        room -= element.count * max(smallest, 1)
        if room < -1:  # the last ASCII row may lack its line end
            raise FormatError(
                path,
                f"element {element.name}",
                f"claims {element.count} rows, more than the file has bytes for; {_AGAIN}",
                code=Code.MESH_COUNT,
            )
    if not any(element.name == "vertex" and element.count for element in elements):
        raise FormatError(
            path, "header", "has no vertices; export it again with geometry", code=Code.MESH_EMPTY
        )
    return content


def find_ply_body(path: Location, content: bytes) -> int:
    """Give the place of the first byte after a PLY header."""
    end = re.search(rb"end_header[ \t]*(\r\n|\n|\r)", content[:_LARGEST_HEADER])
    if not end:
        raise FormatError(
            path, "header", f"has no end_header line; {_AGAIN}", code=Code.MESH_HEADER
        )
    if end[1] == b"\r\n" and b"\n" not in content[: end.start()]:
        return end.end() - 1  # the header's lines end in returns alone: the feed is of the body
    return end.end()


def read_ply_elements(path: Location, lines: list[str]) -> list[PlyElement]:
    """Read the element and property lines of a PLY header."""
    elements: list[PlyElement] = []
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words[:1] == ["element"]:
            if len(words) != 3 or not words[2].isdecimal() or not words[2].isascii():
                raise FormatError(
                    path,
                    f"line {number}",
                    f"wanted element NAME COUNT, got {line!r}",
                    code=Code.MESH_HEADER,
                )
            elements.append(PlyElement(words[1], int(words[2][:18])))
        elif words[:1] == ["property"]:
            kinds = words[2:4] if words[1:2] == ["list"] else words[1:2]
            wrong = not elements or len(words) != 3 + 2 * (words[1:2] == ["list"])
            if wrong or not all(kind in PLY_SIZES for kind in kinds):
                raise FormatError(
                    path,
                    f"line {number}",
                    f"wanted property TYPE NAME, got {line!r}",
                    code=Code.MESH_HEADER,
                )
            if len(kinds) == 2:
                elements[-1].lists.append((elements[-1].row_bytes, kinds[0], kinds[1]))
            elements[-1].properties.append(words[-1])
            elements[-1].kinds.append(kinds[0])
            elements[-1].row_bytes += PLY_SIZES[kinds[0]]
    return elements

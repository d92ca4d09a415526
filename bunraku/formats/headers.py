"""What PLY, STL and OFF headers claim, checked against the bytes that are there."""

import re
from dataclasses import dataclass, field

from bunraku.errors import Code, announce
from bunraku.formats.files import Location
from bunraku.types import FormatError

PLY_SIZES = {
    **{name: 1 for name in ("char", "uchar", "int8", "uint8")},
    **{name: 2 for name in ("short", "ushort", "int16", "uint16", "float16")},
    **{name: 4 for name in ("int", "uint", "int32", "uint32", "float", "float32")},
    **{name: 8 for name in ("int64", "uint64", "double", "float64")},
}
_LARGEST_HEADER = 1 << 16
STL_UNCOUNTED = (0, 0xFFFFFFFF)
_AGAIN = "export or download it again"


@dataclass
class PlyElement:
    """An element of a PLY header: how many rows, and at least how many bytes each takes."""

    name: str
    count: int
    properties: list[str] = field(default_factory=list)
    row_bytes: int = 0
    lists: list[tuple[int, str, str]] = field(default_factory=list)  # place in the row, types


def check_ply(path: Location, content: bytes) -> bytes:
    """Raise a FormatError unless a PLY header is sound and its counts fit into the file."""
    body = find_ply_body(path, content)
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
            elements[-1].row_bytes += PLY_SIZES[kinds[0]]
    return elements


def check_stl(path: Location, content: bytes) -> bytes:
    """Raise a FormatError unless an STL file is text, or has as many triangles as it claims.

    Returns:
        the file, with its triangles counted if the header left them open, and without a tail.
    """
    count = int.from_bytes(content[80:84], "little")
    is_text = re.match(rb"\s*solid\b", content, re.IGNORECASE) and b"\0" not in content[:512]
    tail = len(content) - 84 - 50 * count
    if not is_text and count in STL_UNCOUNTED and len(content) > 84 and len(content) % 50 == 34:
        count = (len(content) - 84) // 50  # those who write as they go leave the count as it was
        message = f"the header does not count the triangles; all {count} are read"
        announce(path, message, code=Code.MESH_COUNT, where="header")
        content = content[:80] + count.to_bytes(4, "little") + content[84:]
    elif not is_text and count and tail > 0:
        message = f"{tail} bytes follow the {count} triangles of the header; they are left out"
        announce(path, message, code=Code.MESH_COUNT, where="header")
        content = content[: 84 + 50 * count]
    if len(content) >= 84 and len(content) == 84 + 50 * count:
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
    return _check_ascii_stl(path, content)


def _check_ascii_stl(path: Location, content: bytes) -> bytes:
    """Raise a FormatError unless every vertex line of an ASCII STL has three numbers."""
    lines = content.decode("utf-8", "replace").replace("\r", "\n").split("\n")
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if words[:1] in (["vertex"], ["VERTEX"]):
            try:
                _x, _y, _z = map(float, words[1:])
            except ValueError:
                raise FormatError(
                    path,
                    f"line {number}",
                    f"wanted vertex x y z, got {line.strip()[:50]!r}",
                    code=Code.MESH_NUMBER,
                ) from None
    text = "\n".join(lines)
    if not re.search(r"endsolid", text, re.IGNORECASE):
        text += "\nendsolid\n"
        message = "ends without endsolid: some of it may be missing"
        announce(path, message, code=Code.MESH_COUNT, where=f"line {len(lines)}")
    return text.encode()


def check_off(path: Location, content: bytes) -> bytes:
    """Raise a FormatError unless an OFF header is sound and its counts fit into the file.

    Returns:
        the file with the counts on their own line, and without normals, colours or 4D.
    """
    text = re.sub(r"#[^\n]*", "", content.decode("utf-8-sig", "replace").replace("\r", "\n"))
    match = re.match(r"\s*((?:ST)?C?N?4?n?)OFF\b[ \t]*(BINARY)?", text, re.IGNORECASE)
    if not match or match[2] or "4" in match[1] or "n" in match[1]:
        raise FormatError(
            path,
            "line 1",
            "wanted an ASCII OFF of three dimensions; convert it",
            code=Code.MESH_HEADER,
        )
    rows = [row for row in text[match.end() :].split("\n") if row.strip()]
    words = rows[0].split() if rows else []
    if len(words) < 2 or not all(word.isascii() and word.isdecimal() for word in words[:2]):
        raise FormatError(
            path,
            "counts",
            f"wanted vertex and face counts, got {' '.join(words)!r}",
            code=Code.MESH_HEADER,
        )
    vertices, faces = int(words[0][:18]), int(words[1][:18])
    if vertices + faces > len(rows) - 1:
        raise FormatError(
            path,
            "counts",
            f"claim {vertices + faces} rows, the file has {len(rows) - 1}; {_AGAIN}",
            code=Code.MESH_COUNT,
        )
    if "C" in match[1].upper() and len(rows[1].split()) <= 3:
        announce(path, "says colours and has none", code=Code.MESH_LEFT_OUT, where="vertex 0")
    if not vertices or not faces:
        raise FormatError(path, "counts", "has no faces; export it as a mesh", code=Code.MESH_EMPTY)
    return "\n".join(["OFF", f"{vertices} {faces} 0", *rows[1 : 1 + vertices + faces]]).encode()

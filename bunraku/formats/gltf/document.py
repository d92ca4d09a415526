"""Open a glTF document: container, JSON, buffers; every index and byte range checked once.

Nothing is allocated before plain integers say that the bytes are there.
"""

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgspec

from bunraku import limits
from bunraku.errors import WARNING, Code, announce
from bunraku.formats.files import Location, read_bytes
from bunraku.formats.gltf.checks import check_ranges, check_references
from bunraku.formats.gltf.parsing import parse_json
from bunraku.formats.gltf.schema import Gltf, Image, Node
from bunraku.formats.gltf.uris import read_uri
from bunraku.formats.pictures import count_pixels
from bunraku.types import FormatError

MAGIC, JSON_CHUNK, BINARY_CHUNK = b"glTF", 0x4E4F534A, 0x004E4942
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
COMPRESSED = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DECOMPRESS = "decompress it first: npx @gltf-transform/cli copy IN.glb OUT.glb"
UNDERSTOOD = ("KHR_mesh_quantization", "KHR_draco_mesh_compression")
HARMLESS = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "VRM")


@dataclass(frozen=True, eq=False)
class Document:
    """A glTF file as it was found."""

    path: str
    json: bytes  # the source of `gltf`, and of the document that is written back
    gltf: Gltf
    buffers: tuple[memoryview, ...]
    is_binary: bool  # a GLB whose only buffer is its own chunk

    def fault(self, where: str, message: str, *, code: Code) -> FormatError:
        """Make the error that something at a JSON pointer is wrong."""
        return FormatError(self.path, where, message, code=code)

    def warn(self, where: str, message: str, *, code: Code, level: int = WARNING) -> None:
        """Announce something odd that was repaired or left out."""
        announce(self.path, message, code=code, where=where, level=level)

    def copy_json(self) -> dict[str, Any]:
        """Give the JSON as a dictionary that the caller may change, keys in the file's order."""
        return dict(msgspec.json.decode(self.json))


def read_document(path: Location, content: bytes | None = None) -> Document:
    """Open a .glb, .gltf or .vrm file and check that its parts fit together.

    Args:
        path: the file; relative URIs start from its folder.
        content: its bytes, if they are known already.

    Raises:
        FormatError: with a JSON pointer, if the file cannot be trusted.
    """
    name = os.fspath(path)
    content = read_bytes(path) if content is None else content
    json, chunk = split_container(name, content)
    json, gltf = parse_json(name, json)
    _refuse_compression(name, gltf)
    check_references(name, gltf)
    check_ranges(name, gltf)
    buffers = tuple(_load_buffers(name, gltf, chunk))
    is_binary = chunk is not None and len(buffers) == 1 and gltf.buffers[0].uri is None
    document = Document(name, json, gltf, buffers, is_binary)
    _announce_oddities(document, content)
    return document


def split_container(path: str, content: bytes) -> tuple[bytes, memoryview | None]:
    """Split a file into its JSON and, for a GLB that has one, its binary chunk."""
    if not content.startswith(MAGIC):
        text = content.removeprefix(BYTE_ORDER_MARK)
        if text.lstrip()[:1] != b"{":
            raise FormatError(
                path, "", "is neither a GLB nor a glTF JSON document", code=Code.GLTF_JSON
            )
        return text, None
    if len(content) < 20:
        raise FormatError(
            path,
            "",
            f"GLB is cut off: {len(content)} bytes are no document",
            code=Code.GLTF_CONTAINER,
        )
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise FormatError(
            path,
            "",
            f"GLB version {version}; only 2 is read, export it again",
            code=Code.GLTF_VERSION,
        )
    if length > len(content):
        message = f"GLB is cut off: it says {length} bytes and has {len(content)}"
        raise FormatError(path, "", message, code=Code.GLTF_CONTAINER)
    chunks = list(_split_chunks(path, memoryview(content)[:length]))
    if not chunks or chunks[0][0] != JSON_CHUNK:
        raise FormatError(
            path, "", "GLB does not begin with a JSON chunk", code=Code.GLTF_CONTAINER
        )
    binary = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == BINARY_CHUNK else None
    return bytes(chunks[0][1]), binary


def _split_chunks(path: str, content: memoryview) -> Iterator[tuple[int, memoryview]]:
    offset = 12
    while offset + 8 <= len(content):
        length, kind = struct.unpack_from("<II", content, offset)
        if offset + 8 + length > len(content):
            message = f"GLB chunk at byte {offset} says {length} bytes, more than the file has"
            raise FormatError(path, "", message, code=Code.GLTF_CONTAINER)
        yield kind, content[offset + 8 : offset + 8 + length]
        offset += 8 + length


def _refuse_compression(path: str, gltf: Gltf) -> None:
    for name in gltf.extensions_required:
        if name in COMPRESSED:
            message = f"geometry is meshopt compressed; {DECOMPRESS}"
            raise FormatError(path, "/extensionsRequired", message, code=Code.GLTF_COMPRESSED)


def _announce_oddities(document: Document, content: bytes) -> None:
    """Warn of what is kept without being understood, is missing, or is left behind."""
    for name in document.gltf.extensions_required:
        if not name.startswith(HARMLESS) and name not in UNDERSTOOD:
            document.warn(
                "/extensionsRequired",
                f"required extension {name[:60]} is kept, but not understood",
                code=Code.GLTF_EXTENSION,
            )
    if content.startswith(BYTE_ORDER_MARK):
        document.warn(
            "",
            "begins with a byte order mark, which glTF forbids; it is ignored",
            code=Code.GLTF_JSON,
        )
    if content.startswith(MAGIC):
        extra = len(content) - int.from_bytes(content[8:12], "little")
        if extra:
            document.warn(
                "", f"{extra} bytes after the end of the GLB are ignored", code=Code.GLTF_CONTAINER
            )
    _announce_misfits(document)


def _announce_misfits(document: Document) -> None:
    for index, node in enumerate(document.gltf.nodes):
        if node.weights is not None and not _has_targets(document.gltf, node):
            document.warn(
                f"/nodes/{index}/weights",
                "are not one for each morph target",
                code=Code.GLTF_SCHEMA,
            )
    for index, image in enumerate(document.gltf.images):
        where = f"/images/{index}"
        try:
            pixels = count_pixels(read_image(document, where, image))
        except FormatError as problem:
            document.warn(problem.where, problem.message, code=problem.code)
            continue
        if pixels > limits.PIXELS:
            message = f"more than {limits.PIXELS} pixels; it is kept, but scale it down"
            document.warn(where, message, code=Code.LIMIT_PIXELS)


def read_image(document: Document, where: str, image: Image) -> bytes:
    """Fetch the bytes of an image, wherever they are."""
    if image.uri is not None:
        return read_uri(document.path, f"{where}/uri", image.uri)[0]
    if image.buffer_view is None:
        return b""
    view = document.gltf.buffer_views[image.buffer_view]
    content = document.buffers[view.buffer]
    return bytes(content[view.byte_offset : view.byte_offset + view.byte_length])


def _has_targets(gltf: Gltf, node: Node) -> bool:
    """Tell whether a node has a weight for each morph target of its mesh."""
    if node.mesh is None or node.weights is None:
        return False
    primitives = gltf.meshes[node.mesh].primitives
    return all(len(primitive.targets) == len(node.weights) for primitive in primitives)


def _load_buffers(path: str, gltf: Gltf, chunk: memoryview | None) -> Iterator[memoryview]:
    for index, buffer in enumerate(gltf.buffers):
        where = f"/buffers/{index}"
        if buffer.uri is not None:
            content = memoryview(read_uri(path, f"{where}/uri", buffer.uri)[0])
        elif index == 0 and chunk is not None:
            content = chunk
        else:
            raise FormatError(
                path,
                where,
                "buffer has no data: neither a URI nor a GLB chunk",
                code=Code.GLTF_BUFFER,
            )
        if len(content) < buffer.byte_length:
            message = f"buffer says {buffer.byte_length} bytes, its source has {len(content)}"
            raise FormatError(path, f"{where}/byteLength", message, code=Code.GLTF_BUFFER)
        yield content[: buffer.byte_length]

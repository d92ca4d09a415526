"""A document in the making: its JSON and one binary chunk, both only ever added to."""

import struct
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Shaped

from bunraku.errors import Code
from bunraku.formats.gltf.document import BINARY_CHUNK, JSON_CHUNK, MAGIC, Document
from bunraku.formats.gltf.schema import COMPONENTS
from bunraku.formats.gltf.uris import read_uri
from bunraku.types import FormatError

ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
CODES = {kind: code for code, kind in COMPONENTS.items()}
PICTURES = {
    b"\x89PNG": "image/png",
    b"\xff\xd8\xff": "image/jpeg",
    b"RIFF": "image/webp",
    b"\xabKTX": "image/ktx2",
}


@dataclass(frozen=True, eq=False)
class Draft:
    """The JSON as a dictionary, and the bytes of its only buffer."""

    json: dict[str, Any]
    binary: bytearray

    def append(self, section: str, item: dict[str, Any]) -> int:
        """Add an item to a top-level list, which is made if need be; return its index."""
        items: list[Any] = self.json.setdefault(section, [])
        items.append(item)
        return len(items) - 1

    def add_bytes(self, content: bytes, **properties: int) -> int:
        """Add a buffer view of these bytes; return its index."""
        self.binary.extend(bytes(-len(self.binary) % 4))
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(content)}
        self.binary.extend(content)
        return self.append("bufferViews", view | properties)

    def add_array(self, array: Shaped[np.ndarray, "..."], kind: str, **target: int) -> int:
        """Add an accessor with a buffer view of its own; return its index.

        Args:
            array: a row an element, in the component type to be stored.
            kind: the accessor's type, such as VEC3.
            target: `target=` of the buffer view, for vertex attributes and indices.
        """
        return self.add_arrays([array], kind, **target)[0]

    def add_arrays(
        self, arrays: list[Shaped[np.ndarray, "..."]], kind: str, **target: int
    ) -> list[int]:
        """Add accessors of one type that lie behind each other in one buffer view."""
        view = self.add_bytes(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays), **target)
        indices, offset = [], 0
        for array in arrays:
            accessor: dict[str, Any] = {"bufferView": view}
            if offset:
                accessor["byteOffset"] = offset
            accessor |= {"componentType": CODES[array.dtype], "count": len(array), "type": kind}
            indices.append(self.append("accessors", accessor))
            offset += array.nbytes
        return indices

    def add_bounds(self, accessor: int, array: Shaped[np.ndarray, "..."]) -> None:
        """State the smallest and largest value of each component of an accessor."""
        columns = array.reshape(len(array), -1)
        item = self.json["accessors"][accessor]
        item["min"], item["max"] = columns.min(axis=0).tolist(), columns.max(axis=0).tolist()

    def encode(self) -> bytes:
        """Give the GLB file."""
        if self.binary:
            buffers = self.json.setdefault("buffers", [{}])
            buffers[0]["byteLength"] = len(self.binary)
        json = msgspec.json.encode(self.json)
        chunks = _chunk(JSON_CHUNK, json, b" ")
        if self.binary:
            chunks += _chunk(BINARY_CHUNK, bytes(self.binary), b"\0")
        return MAGIC + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def _chunk(kind: int, content: bytes, padding: bytes) -> bytes:
    content += padding * (-len(content) % 4)
    return struct.pack("<II", len(content), kind) + content


def draft_document(document: Document) -> Draft:
    """Copy a document with all it consists of in one GLB: buffers, and pictures beside it."""
    json = document.copy_json()
    if document.is_binary:
        draft = Draft(json, bytearray(document.buffers[0]))
    else:
        draft = Draft(json, bytearray())
        starts = []
        for buffer in document.buffers:
            draft.binary.extend(bytes(-len(draft.binary) % 8))
            starts.append(len(draft.binary))
            draft.binary.extend(buffer)
        for view in json.get("bufferViews", []):
            view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
            view["buffer"] = 0
        if starts:
            json["buffers"] = json["buffers"][:1]
            json["buffers"][0].pop("uri", None)
    _embed_pictures(document, draft)
    return draft


def _embed_pictures(document: Document, draft: Draft) -> None:
    """Bring pictures that lie beside the document into it; those that cannot be had stay named."""
    for index, picture in enumerate(draft.json.get("images", [])):
        uri = picture.get("uri", "data:")
        if uri.startswith("data:"):
            continue
        try:
            content, _ = read_uri(document.path, f"/images/{index}/uri", uri)
        except FormatError:  # announced when the document was opened
            continue
        kinds = (kind for magic, kind in PICTURES.items() if content.startswith(magic))
        kind = picture.get("mimeType") or next(kinds, None)
        if kind is None:
            document.warn(
                f"/images/{index}",
                "unknown picture format; the result still names it",
                code=Code.MATERIAL_MISSING,
            )
            continue
        del picture["uri"]
        picture |= {"bufferView": draft.add_bytes(content), "mimeType": kind}

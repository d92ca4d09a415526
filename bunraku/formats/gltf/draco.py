"""Unpack geometry that is Draco compressed (KHR_draco_mesh_compression); needs the extra `draco`.

The document that comes out has plain accessors in a buffer of its own, so that nobody else needs to
know, and what is written back is plain glTF.
"""

from typing import Any

import msgspec
import numpy as np
from jaxtyping import Shaped

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.formats.gltf.checks import check_ranges, check_references
from bunraku.formats.gltf.document import DECOMPRESS, Document, read_document
from bunraku.formats.gltf.schema import COMPONENTS, WIDTHS, Draco, Gltf, Primitive

EXTENSION = "KHR_draco_mesh_compression"


def read_unpacked(path: Location, content: bytes | None = None) -> Document:
    """Open a document as `read_document` does, its geometry unpacked."""
    return unpack(read_document(path, content))


def unpack(document: Document) -> Document:
    """Give a document without compressed geometry; the same one, if there is none.

    Where the extension is not required, and a primitive has plain arrays too, these are used.

    Raises:
        FormatError: if the decoder is not installed, or does not find what the document says.
    """
    packed = [
        (m, p, primitive, primitive.extensions.draco)
        for m, mesh in enumerate(document.gltf.meshes)
        for p, primitive in enumerate(mesh.primitives)
        if primitive.extensions.draco is not None
    ]
    if not packed:
        return document
    json, binary = document.copy_json(), bytearray()
    for m, p, primitive, draco in packed:
        where = f"/meshes/{m}/primitives/{p}"
        if not _is_plain(document.gltf, primitive):
            for accessor, array in _decode(document, where, primitive, draco).items():
                _add_array(json, binary, accessor, array, buffer=len(document.buffers))
        extensions = json["meshes"][m]["primitives"][p]["extensions"]
        del extensions[EXTENSION]
    for name in ("extensionsUsed", "extensionsRequired"):
        json[name] = [used for used in json.get(name, []) if used != EXTENSION]
        if not json[name]:
            del json[name]
    if binary:
        json.setdefault("buffers", []).append({"byteLength": len(binary)})
    gltf = msgspec.convert(json, Gltf)
    check_references(document.path, gltf)
    check_ranges(document.path, gltf)
    buffers = (*document.buffers, memoryview(bytes(binary))) if binary else document.buffers
    is_binary = document.is_binary and not binary
    return Document(document.path, msgspec.json.encode(json), gltf, buffers, is_binary)


def _is_plain(gltf: Gltf, primitive: Primitive) -> bool:
    """Tell whether all arrays of a primitive are there uncompressed as well, to be used instead."""
    if EXTENSION in gltf.extensions_required:
        return False
    indices = () if primitive.indices is None else (primitive.indices,)
    used = [gltf.accessors[index] for index in (*primitive.attributes.values(), *indices)]
    return all(accessor.buffer_view is not None for accessor in used)


def _decode(
    document: Document, where: str, primitive: Primitive, draco: Draco
) -> dict[int, Shaped[np.ndarray, "..."]]:
    """Decode a primitive's arrays, by accessor, in the component types that the document says."""
    mesh = _call_decoder(document, where, draco)
    stored = {entry["unique_id"]: np.asarray(entry["data"]) for entry in mesh.attributes}
    arrays: dict[int, Shaped[np.ndarray, ...]] = {}
    for name, number in draco.attributes.items():
        if name not in primitive.attributes or number not in stored:
            raise document.fault(
                where, f"compressed {name[:30]} is missing; export it again", code=Code.GLTF_BUFFER
            )
        arrays[primitive.attributes[name]] = stored[number]
    if primitive.indices is not None:
        arrays[primitive.indices] = np.asarray(mesh.faces).reshape(-1, 1)
    for index, array in arrays.items():
        accessor = document.gltf.accessors[index]
        wanted = accessor.count, WIDTHS[accessor.type]
        if array.reshape(len(array), -1).shape != wanted:
            message = f"decodes to shape {array.shape}, not {wanted}; export it again"
            raise document.fault(f"/accessors/{index}", message, code=Code.GLTF_BUFFER)
        arrays[index] = array.astype(COMPONENTS[accessor.component_type])
    return arrays


def _call_decoder(document: Document, where: str, draco: Draco) -> Any:
    """Decode the bytes of a primitive."""
    try:
        from DracoPy import decode
    except ImportError:
        message = f'geometry is Draco compressed; pip install "bunraku[draco]", or {DECOMPRESS}'
        raise document.fault(where, message, code=Code.GLTF_COMPRESSED) from None
    view = document.gltf.buffer_views[draco.buffer_view]
    content = document.buffers[view.buffer][view.byte_offset : view.byte_offset + view.byte_length]
    try:
        mesh = decode(bytes(content))
        if len(mesh.points) > limits.VERTICES or not hasattr(mesh, "faces"):
            raise ValueError("no faces, or too many vertices")
    except MemoryError:
        raise
    except Exception as error:  # the decoder has errors of its own, some of no common kind
        reason = " ".join(str(error).split())[:60]
        message = f"Draco data are damaged ({reason}); export it again"
        raise document.fault(where, message, code=Code.GLTF_BUFFER) from None
    return mesh


def _add_array(
    json: dict[str, Any],
    binary: bytearray,
    accessor: int,
    array: Shaped[np.ndarray, "..."],
    *,
    buffer: int,
) -> None:
    """Give an accessor a buffer view of its own."""
    binary.extend(bytes(-len(binary) % 4))
    rows = np.ascontiguousarray(array.reshape(len(array), -1))
    view = {"buffer": buffer, "byteOffset": len(binary)}
    gap = -rows.dtype.itemsize * rows.shape[1] % 4
    if gap and rows.shape[1] > 1:  # vertex attributes start at multiples of four
        packed = rows.view(np.uint8).reshape(len(rows), -1)
        content = np.pad(packed, ((0, 0), (0, gap))).tobytes()
        view["byteStride"] = packed.shape[1] + gap
    else:
        content = rows.tobytes()
    view["byteLength"] = len(content)
    binary.extend(content)
    json.setdefault("bufferViews", []).append(view)
    json["accessors"][accessor]["bufferView"] = len(json["bufferViews"]) - 1
    json["accessors"][accessor].pop("byteOffset", None)

"""Turn accessors into arrays: any component type, stride, normalisation, sparse or not."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int, Shaped

from bunraku.errors import Code
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.schema import COMPONENTS, WIDTHS

Elements = Float[np.ndarray, "elements width"]


def read_floats(document: Document, index: int, width: int) -> Elements:
    """Decode an accessor of `width` numbers an element, normalised integers mapped to -1..1.

    Raises:
        FormatError: if it is of another type, or does not fit in its bytes.
    """
    accessor = document.gltf.accessors[index]
    values = _read(document, index, width)
    if not accessor.normalized or values.dtype.kind == "f":
        return values.astype(np.float64)
    return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)


def read_integers(document: Document, index: int, width: int) -> Int[np.ndarray, "elements width"]:
    """Decode an accessor of unsigned integers, `width` of them an element.

    Raises:
        FormatError: if it is of another type, or does not fit in its bytes.
    """
    values = _read(document, index, width)
    if values.dtype.kind != "u":
        where = f"/accessors/{index}/componentType"
        raise document.fault(
            where,
            "indices must be unsigned integers; export the file again",
            code=Code.GLTF_ACCESSOR,
        )
    return values.astype(np.int64)


def _read(document: Document, index: int, width: int) -> Shaped[np.ndarray, "..."]:
    """Gather the elements of an accessor in its own component type."""
    accessor = document.gltf.accessors[index]
    if WIDTHS[accessor.type] != width or accessor.type in ("MAT2", "MAT3"):
        wanted = next(name for name, size in reversed(WIDTHS.items()) if size == width)
        raise document.fault(
            f"/accessors/{index}/type",
            f"must be {wanted}, not {accessor.type}",
            code=Code.GLTF_ACCESSOR,
        )
    kind = COMPONENTS[accessor.component_type]
    if accessor.buffer_view is None:
        values = np.zeros((accessor.count, width), kind)
    else:
        view = document.gltf.buffer_views[accessor.buffer_view]
        values = np.ndarray(
            (accessor.count, width),
            kind,
            buffer=document.buffers[view.buffer],
            offset=view.byte_offset + accessor.byte_offset,
            strides=(view.byte_stride or width * kind.itemsize, kind.itemsize),
        )
    return values if accessor.sparse is None else _overlay(document, index, values)


def _overlay(
    document: Document, index: int, values: Shaped[np.ndarray, "..."]
) -> Shaped[np.ndarray, "..."]:
    """Replace the elements that a sparse accessor lists."""
    sparse, width = document.gltf.accessors[index].sparse, values.shape[1]
    assert sparse is not None
    places = _slice(document, sparse.indices, COMPONENTS[sparse.indices.component_type])
    fresh = _slice(document, sparse.values, values.dtype)
    rows = places[: sparse.count].astype(np.int64)
    if len(rows) and rows.max() >= len(values):
        message = f"index {rows.max()} of {len(values)} elements"
        raise document.fault(f"/accessors/{index}/sparse/indices", message, code=Code.GLTF_INDEX)
    result = values.copy()
    result[rows] = fresh[: sparse.count * width].reshape(-1, width)
    return result


def _slice(document: Document, part: Any, kind: np.dtype[Any]) -> Shaped[np.ndarray, "..."]:
    """Read numbers from a place in a buffer view to the view's end."""
    view = document.gltf.buffer_views[part.buffer_view]
    count = (view.byte_length - part.byte_offset) // kind.itemsize
    offset = view.byte_offset + part.byte_offset
    return np.frombuffer(document.buffers[view.buffer], kind, count, offset)

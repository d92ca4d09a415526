"""OBJ, PLY, STL and OFF in, behind checks of what their headers claim; OBJ and PLY out."""

import io
import logging
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from bunraku import limits
from bunraku.errors import Code, announce
from bunraku.formats.files import Location
from bunraku.formats.headers import check_ply, find_ply_body, read_ply_elements
from bunraku.formats.obj import read_obj
from bunraku.formats.off import read_off
from bunraku.formats.pieces import Material, Piece
from bunraku.formats.ply_polygons import split_polygons
from bunraku.formats.ply_text import rewrite_as_binary
from bunraku.formats.polygons import triangulate
from bunraku.formats.stl import read_stl
from bunraku.types import FormatError, Mesh


def read_pieces(path: Location, content: bytes, kind: str) -> tuple[list[Piece], list[Material]]:
    """Read an OBJ, PLY, STL or OFF into triangulated pieces, vertices as stored.

    A PLY without faces is one piece without faces, a point cloud.

    Raises:
        FormatError: if the file is damaged, or holds no geometry.
    """
    pieces, materials = _read(path, content, kind)
    count = sum(len(piece.positions) for piece in pieces)
    if not count:
        raise FormatError(
            path, "", "holds no vertices; export it again with geometry", code=Code.MESH_EMPTY
        )
    if count > limits.VERTICES:
        raise FormatError(
            path,
            "",
            f"has {count} vertices, at most {limits.VERTICES}; decimate it",
            code=Code.LIMIT_VERTICES,
        )
    if len(pieces) > limits.PIECES:
        message = f"has {len(pieces)} groups, at most {limits.PIECES} are read; join them"
        raise FormatError(path, "", message, code=Code.LIMIT_TOTAL)
    for piece in pieces:
        _check_piece(path, piece)
    if not any(len(piece.faces) for piece in pieces):
        announce(path, "has no faces; it is taken as a point cloud", code=Code.MESH_POINTS)
    return pieces, materials


def _read(path: Location, content: bytes, kind: str) -> tuple[list[Piece], list[Material]]:
    """Call the reader of a format; only OBJ has materials."""
    match kind:
        case "obj":
            return read_obj(path, content)
        case "ply":
            return _read_ply(path, content), []
        case "stl":
            return read_stl(path, content), []
    return [read_off(path, content)], []


def _check_piece(path: Location, piece: Piece) -> None:
    """Refuse coordinates and indices that mean nothing."""
    wrong = ~(np.abs(piece.positions) < limits.COORDINATE).all(axis=1)
    if wrong.any():
        first = int(wrong.argmax())
        raise FormatError(
            path,
            f"vertex {first}",
            f"is {piece.positions[first].tolist()}; wanted finite numbers, export it again",
            code=Code.MESH_NONFINITE,
        )
    outside = ((piece.faces < 0) | (piece.faces >= len(piece.positions))).any(axis=1)
    if outside.any():
        first = int(outside.argmax())
        raise FormatError(
            path,
            f"face {first}",
            f"is {piece.faces[first].tolist()}, but there are {len(piece.positions)} vertices, "
            "counted from 0; export it again",
            code=Code.MESH_INDEX,
        )


def _read_ply(path: Location, content: bytes) -> list[Piece]:
    """Read a PLY through trimesh; polygons of different sizes, which it refuses, apart."""
    content = rewrite_as_binary(path, check_ply(path, content))
    content, polygons = split_polygons(path, content)
    piece = _read_with_trimesh(path, content)
    _check_counts(path, content, piece)
    if polygons is None:
        return [piece]
    return [replace(piece, faces=_cut_polygons(path, piece.positions, *polygons))]


def _check_counts(path: Location, content: bytes, piece: Piece) -> None:
    """Raise a FormatError if fewer vertices or faces were read than the header counts."""
    header = content[: find_ply_body(path, content)].decode("utf-8", "replace")
    elements = {part.name: part for part in read_ply_elements(path, header.splitlines())}
    found = {"vertex": len(piece.positions), "face": len(piece.faces)}
    if "face" in elements and len(elements["face"].lists) > 1:
        del found["vertex"]  # vertices are cut apart where their faces differ in UVs
    for name, count in found.items():
        if name in elements and elements[name].count > count:
            message = f"the header counts {elements[name].count} rows, {count} could be read"
            raise FormatError(
                path,
                f"element {name}",
                f"{message}; export or download it again",
                code=Code.MESH_COUNT,
            )
    strips = elements.get("tristrips")
    if strips and strips.count:
        message = "triangle strips are not read; export it again with faces instead"
        if not len(piece.faces):
            raise FormatError(path, "element tristrips", message, code=Code.MESH_LEFT_OUT)
        announce(path, message, code=Code.MESH_LEFT_OUT, where="element tristrips")


def _cut_polygons(
    path: Location,
    positions: Float[np.ndarray, "vertices 3"],
    corners: Int[np.ndarray, " corners"],
    starts: Int[np.ndarray, " starts"],
) -> Int[np.ndarray, "faces 3"]:
    """Cut polygons into triangles, after a look at their corners."""
    few = np.diff(starts) < 3
    wrong = (corners < 0) | (corners >= len(positions))
    if few.any():
        message = "has fewer than three corners; export it again"
        raise FormatError(path, f"face {int(few.argmax())}", message, code=Code.MESH_CORNERS)
    if wrong.any():
        face = int(np.searchsorted(starts, wrong.argmax(), side="right")) - 1
        message = "has a corner that is no vertex; export it again"
        raise FormatError(path, f"face {face}", message, code=Code.MESH_INDEX)
    return corners[triangulate(positions, corners, starts)[0]]


def _read_with_trimesh(path: Location, content: bytes) -> Piece:
    """Let trimesh read a PLY; whatever it raises becomes a FormatError."""
    from trimesh.exchange.ply import load_ply  # takes 0.3 s, and only this format needs it

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # it logs tracebacks
    try:
        with np.errstate(all="ignore"):
            return _piece(path, load_ply(io.BytesIO(content)))
    except FormatError:
        raise
    except Exception as error:  # trimesh raises almost anything on damaged files
        reason = " ".join(str(error).split())[:80]
        raise FormatError(
            path,
            "",
            f"is a damaged PLY file ({type(error).__name__}: {reason})",
            code=Code.MESH_DAMAGED,
        ) from None


def _piece(path: Location, loaded: dict[str, Any]) -> Piece:
    """Take the arrays that we keep out of trimesh's."""
    positions = np.asarray(loaded["vertices"], np.float64).reshape(-1, 3)
    faces = loaded.get("faces")
    faces = np.zeros((0, 3), np.int64) if faces is None or not len(faces) else np.asarray(faces)
    faces = faces.astype(np.int64, copy=False)
    if faces.shape[1] != 3:
        starts = np.arange(len(faces) + 1) * faces.shape[1]
        faces = _cut_polygons(path, positions, faces.reshape(-1), starts)
    count = len(positions)
    return Piece(
        "",
        positions,
        faces,
        normals=_per_vertex(loaded.get("vertex_normals"), count),
        uvs=_per_vertex(getattr(loaded.get("visual"), "uv", None), count),
        colours=_colours(loaded.get("vertex_colors"), count),
    )


def _per_vertex(values: object, count: int) -> np.ndarray | None:
    """Keep values if there is one for every vertex and all are finite."""
    rows = None if values is None else np.asarray(values, np.float64)
    return rows if rows is not None and len(rows) == count and np.isfinite(rows).all() else None


def _colours(values: object, count: int) -> Float[np.ndarray, "vertices channels"] | None:
    """Bring colours to 0..1: bytes are divided by 255, other numbers only if one is above 1."""
    rows = _per_vertex(values, count)
    if rows is None:
        return None
    whole = np.asarray(values).dtype.kind in "iu" or rows.max(initial=0.0) > 1
    return np.clip(rows / (255.0 if whole else 1.0), 0.0, 1.0)


def encode_obj(mesh: Mesh) -> bytes:
    """Write a mesh as OBJ text, vertices in order."""
    lines = ["# bunraku"]
    lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    return ("\n".join(lines) + "\n").encode()


def encode_ply(mesh: Mesh) -> bytes:
    """Write a mesh as binary PLY, vertices in order; without faces, as a point cloud."""
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    if len(mesh.faces):
        header += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    body = mesh.vertices.astype("<f4").tobytes() + faces.tobytes()
    return ("\n".join([*header, "end_header"]) + "\n").encode() + body


def merge_pieces(pieces: list[Piece]) -> Mesh:
    """Put all pieces into one mesh."""
    offsets = np.cumsum([0, *(len(piece.positions) for piece in pieces[:-1])])
    faces = [piece.faces + offset for piece, offset in zip(pieces, offsets, strict=True)]
    return Mesh(np.concatenate([piece.positions for piece in pieces]), np.concatenate(faces))

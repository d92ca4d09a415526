"""What the parts of a figure look like, for formats that cannot hold a glTF document."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from bunraku.formats.gltf.accessors import read_floats
from bunraku.formats.gltf.document import Document, read_image
from bunraku.formats.gltf.figure import FigureDocument
from bunraku.formats.gltf.geometry import Block, read_faces
from bunraku.types import FormatError

WHITE = (1.0, 1.0, 1.0, 1.0)
LARGEST = float(np.finfo(np.float32).max)  # in which colours are written


@dataclass(frozen=True, eq=False)
class Paint:
    """A material: its base colour, and nothing else of it."""

    colour: tuple[float, ...] = WHITE  # linear red, green, blue, and opacity
    picture: bytes = b""  # a PNG or JPEG that the colour is multiplied with; empty for none
    channel: int = 0  # which UVs place the picture


@dataclass(frozen=True, eq=False)
class Look:
    """Triangles of one material."""

    faces: Int[np.ndarray, "faces 3"]  # counted from the figure's first vertex
    first: int  # the figure's vertex that the rows below begin with
    paint: Paint = Paint()
    uvs: Float[np.ndarray, "vertices 2"] | None = None  # in the picture, from its lower left
    normals: Float[np.ndarray, "vertices 3"] | None = None  # unit, in world space


def read_looks(figure: FigureDocument) -> list[Look]:
    """Read the triangles of a figure with base colours, their pictures, UVs and normals.

    All else that materials say is left out; what is damaged looks plain.
    """
    document, first, looks = figure.document, 0, list[Look]()
    told = document.copy_json()
    textures = told.get("textures", [])
    paints = [_read_paint(document, material, textures) for material in told.get("materials", [])]
    for block, place in zip(figure.blocks, figure.world_from_mesh, strict=True):
        looks += [
            _read_look(document, block, index, place=place, first=first, paints=paints)
            for index in block.primitives
        ]
        first += len(block.vertices)
    return looks


def _read_look(
    document: Document,
    block: Block,
    index: int,
    *,
    place: Float[np.ndarray, "4 4"],
    first: int,
    paints: list[Paint],
) -> Look:
    """Read one primitive of a block."""
    mesh, count = document.gltf.nodes[block.node].mesh, len(block.vertices)
    assert mesh is not None
    primitive = document.gltf.meshes[mesh].primitives[index]
    faces = read_faces(document, f"/meshes/{mesh}/primitives/{index}", primitive, count)
    if np.linalg.det(place[:3, :3]) < 0:
        faces = faces[:, ::-1]
    paint = Paint() if primitive.material is None else paints[primitive.material]
    names = primitive.attributes
    uvs = _read_rows(document, names.get(f"TEXCOORD_{paint.channel}"), count=count, width=2)
    normals = _read_rows(document, names.get("NORMAL"), count=count, width=3)
    if normals is not None:
        normals = normals @ np.linalg.inv(place[:3, :3])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    upright = None if uvs is None else uvs * (1.0, -1.0) + (0.0, 1.0)
    return Look(first + faces, first, paint, upright, normals)


def _read_rows(
    document: Document, accessor: int | None, *, count: int, width: int
) -> Float[np.ndarray, "vertices width"] | None:
    """Read an attribute that has a finite row for every vertex, or none."""
    if accessor is None:
        return None
    try:
        rows = read_floats(document, accessor, width)
    except FormatError:
        return None
    return rows if len(rows) == count and np.isfinite(rows).all() else None


def _read_paint(document: Document, material: Any, textures: Any) -> Paint:
    """Read a material's base colour; white where it is damaged."""
    try:
        values = material.get("pbrMetallicRoughness", {})
        colour = tuple(float(value) for value in values.get("baseColorFactor", WHITE))
        texture = values.get("baseColorTexture")
        if len(colour) != len(WHITE) or not all(abs(value) < LARGEST for value in colour):
            return Paint()
        if texture is None:
            return Paint(colour)
        source = textures[texture["index"]]["source"]
        picture = read_image(document, f"/images/{source}", document.gltf.images[source])
        return Paint(colour, picture, int(texture.get("texCoord", 0)))
    except (AttributeError, FormatError, LookupError, OverflowError, TypeError, ValueError):
        return Paint()

"""Geometry on its way into the package: named pieces with materials, and a GLB made of them."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

FLOAT, UINT32 = 5126, 5125
VERTEX_TARGET, INDEX_TARGET = 34962, 34963
POINTS, TRIANGLES = 0, 4


@dataclass(frozen=True, eq=False)
class Material:
    """How a piece looks, as far as the old formats say."""

    name: str
    colour: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    image: bytes = b""  # PNG or JPEG, tinted by the colour
    image_name: str = ""


@dataclass(frozen=True, eq=False)
class Piece:
    """One mesh of a file: a primitive of the GLB that it becomes."""

    name: str
    positions: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]  # none: a point cloud
    normals: Float[np.ndarray, "vertices 3"] | None = None
    uvs: Float[np.ndarray, "vertices 2"] | None = None  # from the lower left, as in OBJ
    colours: Float[np.ndarray, "vertices channels"] | None = None  # RGB or RGBA, 0 to 1
    material: int = -1


def turn_piece(piece: Piece, rotation: Float[np.ndarray, "3 3"]) -> Piece:
    """Rotate a piece about the origin."""
    normals = None if piece.normals is None else piece.normals @ rotation.T
    return replace(piece, positions=piece.positions @ rotation.T, normals=normals)


def linear_from_srgb(colours: Float[np.ndarray, "*colours"]) -> Float[np.ndarray, "*colours"]:
    """Turn colours as displayed, 0 to 1, into linear ones, as glTF has them (IEC 61966-2-1)."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def encode_pieces(pieces: Sequence[Piece], materials: Sequence[Material] = ()) -> bytes:
    """Write pieces as a GLB of static meshes, one a piece, in their order."""
    binary = _Binary()
    document = {
        "asset": {"version": "2.0", "generator": "bunraku"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(pieces)))}],
        "nodes": [{"name": piece.name, "mesh": i} for i, piece in enumerate(pieces)],
        "meshes": [
            {"name": piece.name, "primitives": [_primitive(piece, binary)]} for piece in pieces
        ],
        **_looks(materials, binary),
    }
    document |= {"accessors": binary.accessors, "bufferViews": binary.views}
    document["buffers"] = [{"byteLength": binary.length}]
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    return _glb(text, b"".join(binary.chunks))


class _Binary:
    """The binary chunk while it grows, with the views and accessors into it."""

    def __init__(self) -> None:
        self.chunks: list[bytes] = []
        self.length = 0
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, object]] = []

    def add_view(self, content: bytes, target: int = 0) -> int:
        """Append bytes on a border of four; give the view's number."""
        view = {"buffer": 0, "byteOffset": self.length, "byteLength": len(content)}
        self.views.append(view | ({"target": target} if target else {}))
        padded = content + b"\0" * (-len(content) % 4)
        self.chunks.append(padded)
        self.length += len(padded)
        return len(self.views) - 1

    def add_array(self, array: np.ndarray, target: int) -> int:
        """Append an array of float32 or uint32; give the accessor's number."""
        kind = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[
            1 if array.ndim == 1 else len(array[0])
        ]
        accessor: dict[str, object] = {
            "bufferView": self.add_view(array.tobytes(), target),
            "componentType": FLOAT if array.dtype == np.float32 else UINT32,
            "count": len(array),
            "type": kind,
        }
        if kind == "VEC3":
            accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _primitive(piece: Piece, binary: _Binary) -> dict[str, object]:
    """Store a piece's arrays; give its glTF primitive."""
    uvs = None if piece.uvs is None else piece.uvs * [1, -1] + [0, 1]
    colours = piece.colours
    if colours is not None:
        colours = np.column_stack([linear_from_srgb(colours[:, :3]), colours[:, 3:]])
    arrays = {
        "POSITION": piece.positions,
        "NORMAL": _unit_normals(piece),
        "TEXCOORD_0": uvs,
        "COLOR_0": colours,
    }
    primitive: dict[str, object] = {
        "attributes": {
            name: binary.add_array(array.astype(np.float32), VERTEX_TARGET)
            for name, array in arrays.items()
            if array is not None
        },
        "mode": TRIANGLES if len(piece.faces) else POINTS,
    }
    if len(piece.faces):
        corners = piece.faces.reshape(-1).astype(np.uint32)
        primitive["indices"] = binary.add_array(corners, INDEX_TARGET)
    return primitive | ({"material": piece.material} if piece.material >= 0 else {})


def _unit_normals(piece: Piece) -> Float[np.ndarray, "vertices 3"] | None:
    """Scale normals to length 1, as glTF wants them; leave them out if one has no direction."""
    if piece.normals is None or not np.isfinite(piece.normals).all():
        return None
    lengths = np.linalg.norm(piece.normals, axis=1, keepdims=True)
    return piece.normals / lengths if (lengths > 1e-6).all() else None


def _looks(materials: Sequence[Material], binary: _Binary) -> dict[str, object]:
    """Store materials and their images as glTF lists; the lists that stay empty are left out."""
    images: list[dict[str, object]] = []
    image_of: dict[bytes, int] = {}
    listed: list[dict[str, object]] = []
    for material in materials:
        surface: dict[str, object] = {
            "baseColorFactor": list(material.colour),
            "metallicFactor": 0.0,
            "roughnessFactor": 0.9,
        }
        if material.image:
            if material.image not in image_of:
                image_of[material.image] = len(images)
                images.append(_image(material, binary))
            surface["baseColorTexture"] = {"index": image_of[material.image]}
        listed.append({"name": material.name, "pbrMetallicRoughness": surface})
        if material.colour[3] < 1:
            listed[-1]["alphaMode"] = "BLEND"
    textures = [{"source": i} for i in range(len(images))]
    lists = {"materials": listed, "textures": textures, "images": images}
    return {name: entries for name, entries in lists.items() if entries}


def _image(material: Material, binary: _Binary) -> dict[str, object]:
    """Store an image; give its glTF entry."""
    mime = "image/png" if material.image.startswith(b"\x89PNG") else "image/jpeg"
    view = binary.add_view(material.image)
    return {"name": material.image_name, "mimeType": mime, "bufferView": view}


def _glb(text: bytes, binary: bytes) -> bytes:
    """Join the two chunks under a GLB header."""
    text += b" " * (-len(text) % 4)
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text
    chunks += len(binary).to_bytes(4, "little") + b"BIN\0" + binary
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks

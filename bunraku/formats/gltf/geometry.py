"""The triangles of a document, one block for each vertex buffer that a node shows."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.gltf.accessors import read_floats, read_integers
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.influences import read_influences
from bunraku.formats.gltf.schema import Primitive
from bunraku.formats.gltf.tree import Tree

POINTS, TRIANGLES, STRIP, FAN = 0, 4, 5, 6
SURFACE = {TRIANGLES, STRIP, FAN}
CORNERS = 6  # of faces, a vertex: as many as there are in a closed surface


@dataclass(frozen=True, eq=False)
class Block:
    """The vertices that one node shows of one vertex buffer, in the mesh's own space."""

    node: int
    primitives: tuple[int, ...]  # those of the node's mesh that share these vertices
    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]  # counted from the block's first vertex
    joints: Int[np.ndarray, "vertices influences"]  # places in the skin's list of joints
    weights: Float[np.ndarray, "vertices influences"]  # rows sum to 1; no columns if unskinned
    lost_weights: int = 0  # vertices of whose weights nothing was a number

    @property
    def is_skinned(self) -> bool:
        """Tell whether joints move the block, rather than its node."""
        return self.weights.shape[1] > 0


def read_blocks(document: Document, tree: Tree) -> list[Block]:
    """Read the triangles of every mesh node shown, in the order of the nodes, or else the points.

    Raises:
        FormatError: naming the accessor, if positions, indices or joints are damaged.
    """
    nodes, meshes = document.gltf.nodes, document.gltf.meshes
    shown = [(node, nodes[node].mesh) for node in tree.order if tree.is_shown[node]]
    pairs = [(node, mesh) for node, mesh in shown if mesh is not None]
    modes = {primitive.mode for _, mesh in pairs for primitive in meshes[mesh].primitives}
    wanted = SURFACE if modes & SURFACE else {POINTS}
    if modes and not modes & SURFACE:
        document.warn("", "has no faces; it is taken as a point cloud", code=Code.MESH_POINTS)
    groups = [
        (node, mesh, group) for node, mesh in pairs for group in _group(document, mesh, wanted)
    ]
    _check_size(document, groups)
    return [_read_block(document, *group) for group in groups]


def _check_size(document: Document, groups: list[tuple[int, int, tuple[int, ...]]]) -> None:
    """Refuse more pieces or vertices than are read, in plain integers, before any is read."""
    gltf, shown, corners, stored = document.gltf, 0, 0, dict[int, int]()
    for _, mesh, group in groups:
        primitives = [gltf.meshes[mesh].primitives[index] for index in group]
        position = primitives[0].attributes["POSITION"]
        stored[position] = gltf.accessors[position].count
        shown += stored[position]
        for item in primitives:
            indices = position if item.indices is None else item.indices
            corners += gltf.accessors[indices].count * (1 if item.mode == TRIANGLES else 3)
    message, code = "", Code.LIMIT_TOTAL
    if len(groups) > limits.PIECES:
        message = f"nodes show {len(groups)} meshes, at most {limits.PIECES} are read; join them"
    elif shown > limits.VERTICES:
        message = f"more than {limits.VERTICES} vertices; decimate it first"
        code = Code.LIMIT_VERTICES
    elif corners > CORNERS * limits.VERTICES:
        message = f"more than {CORNERS * limits.VERTICES} corners of faces; decimate it first"
    elif shown - sum(stored.values()) > limits.REPEATED:
        message = f"nodes show more than {limits.REPEATED} vertices again; leave out the copies"
    if message:
        raise document.fault("/meshes", message, code=code)


def _group(document: Document, mesh: int, wanted: set[int]) -> list[tuple[int, ...]]:
    """Put the primitives of a mesh together that share their vertices; tell what is left out."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for index, primitive in enumerate(document.gltf.meshes[mesh].primitives):
        where = f"/meshes/{mesh}/primitives/{index}"
        if primitive.mode not in wanted:
            document.warn(
                where,
                "points or lines are kept, but are no part of the surface",
                code=Code.MESH_LEFT_OUT,
            )
        elif "POSITION" not in primitive.attributes:
            document.warn(
                where,
                "a primitive without POSITION is kept, but shows nothing",
                code=Code.MESH_LEFT_OUT,
            )
        else:
            groups.setdefault(_vertex_buffer(primitive), []).append(index)
    return [tuple(group) for group in groups.values()]


def _vertex_buffer(primitive: Primitive) -> tuple[int, ...]:
    """Give what tells apart the vertices of primitives: position and skin accessors."""
    names = sorted(name for name in primitive.attributes if name.startswith(("JOINTS", "WEIGHTS")))
    return tuple(primitive.attributes[name] for name in ["POSITION", *names])


def _read_block(document: Document, node: int, mesh: int, group: tuple[int, ...]) -> Block:
    primitives = document.gltf.meshes[mesh].primitives
    vertices = read_positions(document, primitives[group[0]].attributes["POSITION"])
    faces = []
    for index in group:
        where = f"/meshes/{mesh}/primitives/{index}"
        faces.append(read_faces(document, where, primitives[index], len(vertices)))
    where = f"/meshes/{mesh}/primitives/{group[0]}"
    moved = read_influences(document, node, where, vertices=vertices)
    return Block(node, group, vertices, np.concatenate(faces), *moved)


def read_positions(document: Document, accessor: int) -> Float[np.ndarray, "vertices 3"]:
    """Read the positions of a vertex buffer.

    Raises:
        FormatError: naming the first vertex that is not finite or too far away.
    """
    vertices = read_floats(document, accessor, 3)
    wrong = ~(np.abs(vertices) < limits.COORDINATE).all(axis=1)
    if wrong.any():
        message = (
            f"{wrong.sum()} vertices are NaN, infinite or beyond {limits.COORDINATE:.0e}, "
            f"first {int(wrong.argmax())}"
        )
        raise document.fault(
            f"/accessors/{accessor}", f"{message}; repair the mesh", code=Code.MESH_NONFINITE
        )
    return vertices


def read_faces(
    document: Document, where: str, primitive: Primitive, count: int
) -> Int[np.ndarray, "faces 3"]:
    """Read the triangles of a primitive over `count` vertices; points have none.

    Raises:
        FormatError: if one names a vertex that is not there.
    """
    if primitive.mode == POINTS:
        return np.zeros((0, 3), np.int64)
    if primitive.indices is None:
        corners = np.arange(count)
    else:
        corners = read_integers(document, primitive.indices, 1)[:, 0]
        if corners.max() >= count:
            place = int((corners >= count).argmax())
            message = f"index {place} is vertex {corners[place]} of {count}; export the mesh again"
            raise document.fault(f"/accessors/{primitive.indices}", message, code=Code.MESH_INDEX)
    if primitive.mode == TRIANGLES:
        if len(corners) % 3:
            document.warn(
                where,
                f"{len(corners)} corners are no whole triangles; the rest is cut",
                code=Code.MESH_CORNERS,
            )
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if len(corners) < 3:
        return np.zeros((0, 3), np.int64)
    return _unroll(corners, primitive.mode)


def _unroll(corners: Int[np.ndarray, " corners"], mode: int) -> Int[np.ndarray, "faces 3"]:
    """Turn a strip or fan into triangles, dropping those that only join strips."""
    if mode == STRIP:
        faces = np.lib.stride_tricks.sliding_window_view(corners, 3).copy()
        faces[1::2, 1:] = faces[1::2, :0:-1]
    else:
        first = np.full(len(corners) - 2, corners[0])
        faces = np.column_stack([corners[1:-1], corners[2:], first])
    return faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]

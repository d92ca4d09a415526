"""Put a skeleton, skins and weights into a draft."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from bunraku.formats.gltf.draft import ARRAY_BUFFER, Draft
from bunraku.formats.gltf.figure import FigureDocument
from bunraku.formats.gltf.geometry import read_positions
from bunraku.rotations import decompose_transforms, matrices_to_quaternions
from bunraku.skinning import keep_influences
from bunraku.types import NO_PARENT, Character, Skeleton

CHUNK = 65536  # vertices at a time, to keep memory flat
SMALL = 1e-9  # what counts as no translation, rotation or scale


def add_skeleton(
    draft: Draft, skeleton: Skeleton, *, name: str, file_from_world: Float[np.ndarray, "4 4"]
) -> list[int]:
    """Add a node for each joint, under a node of their own if one is needed; return the joints'.

    Args:
        draft: what is changed.
        skeleton: the joints; their rest pose becomes the nodes' default.
        name: of the node above several roots, or above roots in a file with axes of its own.
        file_from_world: from our axes to the file's.
    """
    first = len(draft.json.get("nodes", []))
    nodes = [first + joint for joint in range(len(skeleton.names))]
    for joint, rest in enumerate(skeleton.rest):
        children = [nodes[child] for child in np.flatnonzero(skeleton.parents == joint)]
        draft.append("nodes", _describe_node(skeleton.names[joint], rest, children))
    roots = [nodes[joint] for joint in np.flatnonzero(skeleton.parents == NO_PARENT)]
    if len(roots) > 1 or not np.allclose(file_from_world, np.eye(4), atol=1e-12):
        roots = [draft.append("nodes", _describe_node(name, file_from_world, roots))]
    _show(draft.json, roots, before=first)
    return nodes


def _describe_node(
    name: str, transform: Float[np.ndarray, "4 4"], children: list[int]
) -> dict[str, Any]:
    """Write a node; parts of its transform that do nothing are left out."""
    translation, rotation, scale = decompose_transforms(transform)
    node: dict[str, Any] = {"name": name}
    if np.abs(translation).max() > SMALL:
        node["translation"] = translation.tolist()
    if np.abs(rotation - np.eye(3)).max() > SMALL:
        node["rotation"] = matrices_to_quaternions(rotation).tolist()
    if np.abs(scale - 1).max() > SMALL:
        node["scale"] = scale.tolist()
    return node | ({"children": children} if children else {})


def _show(json: dict[str, Any], roots: list[int], *, before: int) -> None:
    """Add roots to the scene; a file without one gets one with all that it has."""
    if not json.get("scenes"):
        below = {child for node in json["nodes"][:before] for child in node.get("children", [])}
        json["scenes"] = [{"nodes": [node for node in range(before) if node not in below]}]
        json["scene"] = 0
    scene = json["scenes"][json.get("scene", 0)]
    scene["nodes"] = scene.get("nodes", []) + roots


def add_skins(
    draft: Draft, figure: FigureDocument, character: Character, *, joints: list[int]
) -> None:
    """Bind every mesh node of the figure to the joints, in the pose in which the figure stands."""
    skins: dict[bytes, int] = {}
    for node, place in _mesh_places(figure).items():
        joint_from_mesh = character.skin.inverse_bind @ place
        columns = joint_from_mesh.transpose(0, 2, 1).astype(np.float32).reshape(-1, 16)
        key = columns.tobytes()
        if key not in skins:
            accessor = draft.add_array(columns, "MAT4")
            skin = {"inverseBindMatrices": accessor, "joints": joints}
            skins[key] = draft.append("skins", skin)
        draft.json["nodes"][node]["skin"] = skins[key]


def _mesh_places(figure: FigureDocument) -> dict[int, Float[np.ndarray, "4 4"]]:
    """Give world_from_mesh of each node of the figure."""
    places: dict[int, Float[np.ndarray, "4 4"]] = {}
    for block, place in zip(figure.blocks, figure.world_from_mesh, strict=True):
        places.setdefault(block.node, place)
    return places


def add_weights(
    draft: Draft, figure: FigureDocument, weights: Float[np.ndarray, "vertices joints"]
) -> None:
    """Give each primitive of the figure its joints and weights, at most four a vertex.

    Meshes that several nodes show are copied, because their weights differ. Points and lines of
    a mesh follow the surface nearest to them.
    """
    document, first, owned = figure.document, 0, set[int]()
    done: dict[int, list[tuple[int, Any, Any]]] = {}
    for block in figure.blocks:
        rows = weights[first : first + len(block.vertices)]
        first += len(block.vertices)
        node = draft.json["nodes"][block.node]
        if block.node not in done:
            done[block.node] = []
            if node["mesh"] in owned:
                node["mesh"] = draft.append("meshes", _copy_mesh(draft.json, node["mesh"]))
            owned.add(node["mesh"])
        primitives = draft.json["meshes"][node["mesh"]]["primitives"]
        attributes = _add_influences(draft, rows)
        for index in block.primitives:
            primitives[index]["attributes"] |= attributes
        done[block.node].append((0, block.vertices, rows))
    for index, parts in done.items():
        mesh = draft.json["meshes"][draft.json["nodes"][index]["mesh"]]
        surface = cKDTree(np.concatenate([vertices for _, vertices, _ in parts]))
        rows = np.concatenate([part for _, _, part in parts])
        for primitive in mesh["primitives"]:
            names = primitive["attributes"]
            if "WEIGHTS_0" not in names and "POSITION" in names:
                points = read_positions(document, names["POSITION"])
                names |= _add_influences(draft, rows[surface.query(points)[1]])


def _copy_mesh(json: dict[str, Any], mesh: int) -> dict[str, Any]:
    """Copy a mesh that another node shows, without that node's weights."""
    source = json["meshes"][mesh]
    primitives = [
        primitive
        | {
            "attributes": {
                name: accessor
                for name, accessor in primitive["attributes"].items()
                if name not in ("JOINTS_0", "WEIGHTS_0")
            }
        }
        for primitive in source["primitives"]
    ]
    return dict(source) | {"primitives": primitives}


def _add_influences(draft: Draft, weights: Float[np.ndarray, "vertices joints"]) -> dict[str, int]:
    """Add JOINTS_0 and WEIGHTS_0 of some vertices."""
    rows = range(0, len(weights), CHUNK)
    parts = [strongest_influences(weights[row : row + CHUNK]) for row in rows]
    joints, shares = (np.concatenate(half) for half in zip(*parts, strict=True))
    kind = np.dtype("<u1") if weights.shape[1] <= 256 else np.dtype("<u2")
    return {
        "JOINTS_0": draft.add_array(joints.astype(kind), "VEC4", target=ARRAY_BUFFER),
        "WEIGHTS_0": draft.add_array(shares, "VEC4", target=ARRAY_BUFFER),
    }


def strongest_influences(
    weights: Float[np.ndarray, "vertices joints"],
) -> tuple[Int[np.ndarray, "vertices 4"], Float[np.ndarray, "vertices 4"]]:
    """Choose the four largest weights of each vertex, largest first, of sum 1 in float32.

    Returns:
        the joints, 0 where the weight is 0, and the weights in float32.
    """
    kept = keep_influences(weights, 4)
    joints = np.zeros((len(kept), 4), np.int64)
    shares = np.zeros((len(kept), 4), np.float32)
    count = min(4, weights.shape[1])
    joints[:, :count] = np.argsort(-kept, axis=1, kind="stable")[:, :count]
    shares[:, :count] = np.take_along_axis(kept, joints[:, :count], axis=1)
    shares[:, 0] = 1.0 - shares[:, 1:].astype(np.float64).sum(axis=1)
    return np.where(shares > 0, joints, 0), shares

"""Read a glTF file as a character: rigid joint frames, the mesh in its bind pose, all clips."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.formats.gltf.binding import (
    Binding,
    add_rigid_joints,
    animated_nodes,
    bind_skins,
    place_block,
    sort_joints,
)
from bunraku.formats.gltf.clips import build_frames, read_clips
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.draco import read_unpacked
from bunraku.formats.gltf.figure import join_blocks
from bunraku.formats.gltf.geometry import Block, read_blocks
from bunraku.formats.gltf.tree import Tree, build_tree
from bunraku.rotations import compose_transforms, invert_rigid, nearest_rotation
from bunraku.skinning import linear_blend_skinning, local_transforms
from bunraku.types import NO_PARENT, Character, Clip, Mesh, Skeleton, Skin

FLATTEST = 1e-40  # volume of axes that can still be inverted
SAME_POSE = 1e-4  # how far apart, as a share of the size, two binds of one joint count as one


def read_character(path: Location, content: bytes | None = None) -> Character:
    """Read a rigged glTF file: metres, Y up, rigid joint frames, the mesh in its bind pose.

    Meshes that hang on joints without a skin follow them rigidly. In a file without skins the
    animated nodes are the joints. A file with a rig but no mesh gives a mesh of no vertices.

    Args:
        path: the file.
        content: its bytes, if they are known already.

    Raises:
        FormatError: if the file cannot be trusted, or nothing in it can move.
    """
    document = read_unpacked(path, content)
    tree = build_tree(document)
    return build_character(document, tree, read_blocks(document, tree))


@dataclass(frozen=True, eq=False)
class Rig:
    """What moves the meshes of a document."""

    nodes: tuple[int, ...]  # of the joints, parents first
    binding: Binding
    rest: Float[np.ndarray, "joints 4 4"]  # world_from_joint when the meshes were bound, rigid
    skeleton: Skeleton
    clips: tuple[Clip, ...]


def build_rig(document: Document, tree: Tree, blocks: list[Block]) -> Rig:
    """Find the joints of a rigged document, their rest pose and clips.

    Raises:
        FormatError: if there are no joints, or more than are read.
    """
    if not document.gltf.skins and not animated_nodes(document):
        message = "is not rigged: it has neither a skin nor animated nodes"
        raise document.fault("", message, code=Code.RIG_MISSING)
    binding = add_rigid_joints(document, tree, blocks, bind_skins(document, tree, blocks))
    if len(binding.bind) > limits.JOINTS:
        message = f"{len(binding.bind)} joints, at most {limits.JOINTS} are read; leave some out"
        raise document.fault("/nodes", message, code=Code.LIMIT_JOINTS)
    _check_weights(document, blocks)
    _announce_roots(document, tree)
    nodes, parents = sort_joints(tree, set(binding.bind))
    bind = np.stack([binding.bind[node] for node in nodes])
    volume = np.abs(np.linalg.det(bind[:, :3, :3]))
    flat = ~((volume > FLATTEST) & (volume < 1 / FLATTEST))
    if flat.any():
        where = f"/nodes/{nodes[int(flat.argmax())]}"
        message = "the joint's scale is too small or large to be undone; apply scales and export"
        raise document.fault(where, message, code=Code.NODE_TRANSFORM)
    rest = compose_transforms(bind[:, :3, 3], nearest_rotation(bind[:, :3, :3]))
    frames = build_frames(tree, nodes, parents, node_from_joint=np.linalg.inv(bind) @ rest)
    skeleton = Skeleton(name_joints(document, nodes), parents, local_transforms(parents, rest))
    return Rig(nodes, binding, rest, skeleton, read_clips(document, tree, frames))


def _check_weights(document: Document, blocks: list[Block]) -> None:
    """Refuse a rig of which no weight at all is a number: there is nothing to repair from."""
    skinned = [block for block in blocks if block.is_skinned]
    if skinned and all(block.lost_weights == len(block.vertices) for block in skinned):
        message = "not one skinning weight is a number; bind the mesh again"
        raise document.fault("/meshes", message, code=Code.SKIN_WEIGHTS)


def _announce_roots(document: Document, tree: Tree) -> None:
    """Warn of skins whose joints are not shown, or hang on different roots and move apart."""
    root = np.arange(len(tree.parents))
    for node in tree.order:
        if tree.parents[node] != NO_PARENT:
            root[node] = root[tree.parents[node]]
    used = {node.skin for node in document.gltf.nodes if node.skin is not None}
    for index, skin in enumerate(document.gltf.skins):
        if index in used and not tree.is_shown[skin.joints].any():
            message = "no joint is in the scene that shows the mesh; export them together"
            document.warn(f"/skins/{index}/joints", message, code=Code.SKIN_JOINTS)
        count = len(np.unique(root[skin.joints]))
        if count > 1:
            message = f"joints hang on {count} roots; each part moves by itself"
            document.warn(f"/skins/{index}/joints", message, code=Code.SKIN_JOINTS)


def build_character(document: Document, tree: Tree, blocks: list[Block]) -> Character:
    """Put the parts of a rigged document together; see `read_character`."""
    rig = build_rig(document, tree, blocks)
    vertices, joints = sum(len(block.vertices) for block in blocks), len(rig.nodes)
    if vertices * joints > limits.WEIGHTS:
        message = (
            f"{vertices} vertices times {joints} joints, at most {limits.WEIGHTS} are read; "
            "decimate the mesh"
        )
        raise document.fault("/skins", message, code=Code.LIMIT_TOTAL)
    place = {node: joint for joint, node in enumerate(rig.nodes)}
    parts = [_spread_weights(document, tree, block, place=place) for block in blocks]
    skin = Skin(np.concatenate([np.zeros((0, joints)), *parts]), invert_rigid(rig.rest))
    mesh = _bind_mesh(document, tree, blocks, binding=rig.binding)
    return Character(mesh, rig.skeleton, skin, rig.clips)


def name_joints(document: Document, nodes: tuple[int, ...]) -> tuple[str, ...]:
    """Name each joint like its node; missing and repeated names are made unique."""
    names: dict[str, None] = {}
    repeated: Counter[str] = Counter()
    for node in nodes:
        name = wanted = document.gltf.nodes[node].name or f"joint_{node}"
        while name in names:
            repeated[wanted] += 1
            name = f"{wanted}_{repeated[wanted] + 1}"
        names[name] = None
    return tuple(names)


def _spread_weights(
    document: Document, tree: Tree, block: Block, *, place: dict[int, int]
) -> Float[np.ndarray, "vertices joints"]:
    """Put a block's weights into the columns of all joints."""
    skin = document.gltf.nodes[block.node].skin
    if block.is_skinned and skin is not None:
        columns = np.array([place[node] for node in document.gltf.skins[skin].joints])
        return _dense_weights(block, columns, len(place))
    weights = np.zeros((len(block.vertices), len(place)))
    weights[:, next(place[node] for node in tree.ancestors(block.node) if node in place)] = 1.0
    return weights


def _dense_weights(
    block: Block, columns: Int[np.ndarray, " skin_joints"], width: int
) -> Float[np.ndarray, "vertices joints"]:
    """Sum each vertex's weights into the column of each joint."""
    count = len(block.vertices)
    cells = np.arange(count)[:, None] * width + columns[block.joints]
    return np.bincount(cells.ravel(), block.weights.ravel(), count * width).reshape(count, width)


def _bind_mesh(document: Document, tree: Tree, blocks: list[Block], *, binding: Binding) -> Mesh:
    """Put all blocks into the world, those bound in another pose moved into the common one."""
    places = [place_block(document, tree, binding, block) for block in blocks]
    mesh = join_blocks(document, blocks, np.array(places).reshape(len(blocks), 4, 4))
    ends = np.cumsum([len(block.vertices) for block in blocks], dtype=np.int64)
    size = float(np.ptp(mesh.vertices, axis=0).max()) if len(mesh.vertices) else 1.0
    vertices = mesh.vertices.copy()
    for block, end in zip(blocks, ends, strict=True):
        skin = document.gltf.nodes[block.node].skin
        if not block.is_skinned or skin is None:
            continue
        common = np.stack([binding.bind[node] for node in document.gltf.skins[skin].joints])
        motion = common @ np.linalg.inv(binding.skin_bind[skin])
        here = slice(end - len(block.vertices), end)
        weights = _dense_weights(block, np.arange(len(motion)), len(motion))
        moved = linear_blend_skinning(vertices[here], weights, motion)
        if np.abs(moved - vertices[here]).max() > SAME_POSE * size:
            document.warn(
                f"/skins/{skin}",
                "bound in another pose than others; brought into theirs",
                code=Code.SKIN_BIND,
            )
            vertices[here] = moved
    return Mesh(vertices, mesh.faces)

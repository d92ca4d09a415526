"""Read a glTF file as a character: rigid joint frames, the mesh in its bind pose, all clips."""

import numpy as np
from jaxtyping import Float, Int

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
from bunraku.formats.gltf.document import Document, read_document
from bunraku.formats.gltf.figure import join_blocks
from bunraku.formats.gltf.geometry import Block, read_blocks
from bunraku.formats.gltf.tree import Tree, build_tree
from bunraku.rotations import compose_transforms, invert_rigid, nearest_rotation
from bunraku.skinning import linear_blend_skinning, local_transforms
from bunraku.types import Character, Mesh, Skeleton, Skin

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
    document = read_document(path, content)
    tree = build_tree(document)
    return build_character(document, tree, read_blocks(document, tree))


def build_character(document: Document, tree: Tree, blocks: list[Block]) -> Character:
    """Put the parts of a rigged document together; see `read_character`."""
    if not document.gltf.skins and not animated_nodes(document):
        raise document.fault("", "is not rigged: it has neither a skin nor animated nodes")
    binding = add_rigid_joints(document, tree, blocks, bind_skins(document, tree, blocks))
    nodes, parents = sort_joints(tree, set(binding.bind))
    bind = np.stack([binding.bind[node] for node in nodes])
    rest = compose_transforms(bind[:, :3, 3], nearest_rotation(bind[:, :3, :3]))
    frames = build_frames(tree, nodes, parents, node_from_joint=np.linalg.inv(bind) @ rest)
    skeleton = Skeleton(name_joints(document, nodes), parents, local_transforms(parents, rest))
    place = {node: joint for joint, node in enumerate(nodes)}
    parts = [_spread_weights(document, tree, block, place=place) for block in blocks]
    skin = Skin(np.concatenate([np.zeros((0, len(nodes))), *parts]), invert_rigid(rest))
    mesh = _bind_mesh(document, tree, blocks, binding=binding)
    return Character(mesh, skeleton, skin, read_clips(document, tree, frames))


def name_joints(document: Document, nodes: tuple[int, ...]) -> tuple[str, ...]:
    """Name each joint like its node; missing and repeated names are made unique."""
    names: list[str] = []
    for node in nodes:
        name = wanted = document.gltf.nodes[node].name or f"joint_{node}"
        count = 1
        while name in names:
            count += 1
            name = f"{wanted}_{count}"
        names.append(name)
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
            document.warn(f"/skins/{skin}: bound in another pose than others; brought into theirs")
            vertices[here] = moved
    return Mesh(vertices, mesh.faces)

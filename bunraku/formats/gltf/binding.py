"""Where the joints of a file were when its meshes were bound, in world space."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.formats.gltf.accessors import read_floats
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.geometry import Block
from bunraku.formats.gltf.placement import agree_on_placement
from bunraku.formats.gltf.tree import Tree
from bunraku.types import NO_PARENT

MOVING_PATHS = ("translation", "rotation", "scale")
Matrix = Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Binding:
    """The joints of a file in their bind pose, scale and all, and where its skins lie."""

    bind: dict[int, Matrix]  # node of each joint: world_from_joint
    world_from_mesh: dict[int, Matrix]  # of each skin in use
    skin_bind: dict[int, Float[np.ndarray, "joints 4 4"]]  # the same for each skin by itself


def read_inverse_bind(document: Document, skin: int) -> Float[np.ndarray, "joints 4 4"]:
    """Read joint_from_mesh of a skin; the identity where the file leaves it out.

    Raises:
        FormatError: if matrices are missing, NaN or cannot be inverted.
    """
    count, accessor = len(document.gltf.skins[skin].joints), document.gltf.skins[skin]
    where = f"/skins/{skin}/inverseBindMatrices"
    if accessor.inverse_bind_matrices is None:
        return np.tile(np.eye(4), (count, 1, 1))
    columns = read_floats(document, accessor.inverse_bind_matrices, 16)
    if len(columns) < count:
        raise document.fault(where, f"{len(columns)} matrices for {count} joints")
    matrices = columns[:count].reshape(-1, 4, 4).transpose(0, 2, 1).copy()
    matrices[:, 3] = 0, 0, 0, 1
    finite = np.isfinite(matrices).all(axis=(1, 2))
    volume = np.linalg.det(np.where(finite[:, None, None], matrices, 0.0)[:, :3, :3])
    flat = ~(np.abs(volume) > 1e-30)
    if flat.any():
        message = f"matrix {int(flat.argmax())} is NaN or cannot be inverted; bind the mesh again"
        raise document.fault(where, message)
    return matrices


def bind_skins(document: Document, tree: Tree, blocks: list[Block]) -> Binding:
    """Find the bind pose of every joint of the skins that move something shown.

    If skins differ about a joint, the one that moves more of the mesh is believed. In a file
    without skinned meshes, all skins count.
    """
    mass = _weigh_skins(document, blocks)
    bind: dict[int, Matrix] = {}
    world_from_mesh: dict[int, Matrix] = {}
    skin_bind: dict[int, Float[np.ndarray, "joints 4 4"]] = {}
    for skin in sorted(mass, key=lambda index: (-mass[index].sum(), index)):
        joints, inverse_bind = document.gltf.skins[skin].joints, read_inverse_bind(document, skin)
        mesh_from_joint = np.linalg.inv(inverse_bind)
        opinions = tree.world[joints] @ inverse_bind
        points = mesh_from_joint[:, :3, 3]
        world_from_mesh[skin] = agree_on_placement(opinions, mass[skin], points)
        skin_bind[skin] = world_from_mesh[skin] @ mesh_from_joint
        for place, node in enumerate(joints):
            bind.setdefault(node, skin_bind[skin][place])
    return Binding(bind, world_from_mesh, skin_bind)


def _weigh_skins(
    document: Document, blocks: list[Block]
) -> dict[int, Float[np.ndarray, " joints"]]:
    """Sum the weights of each joint of each skin in use."""
    skins = document.gltf.skins
    mass: dict[int, Float[np.ndarray, " joints"]] = {}
    for block in blocks:
        skin = document.gltf.nodes[block.node].skin
        if block.is_skinned and skin is not None:
            count = len(skins[skin].joints)
            share = np.bincount(block.joints.ravel(), block.weights.ravel(), count)
            mass[skin] = mass.get(skin, np.zeros(count)) + share
    return mass or {skin: np.zeros(len(item.joints)) for skin, item in enumerate(skins)}


def add_rigid_joints(
    document: Document, tree: Tree, blocks: list[Block], binding: Binding
) -> Binding:
    """Make joints of the nodes that move unskinned meshes: those animated, or at the very top.

    A file without any mesh has only its animated nodes to make joints of.
    """
    bind, animated = dict(binding.bind), animated_nodes(document)
    if not blocks and not bind:
        wanted = set(animated)
    else:
        wanted = set()
        for node in {block.node for block in blocks if not block.is_skinned}:
            path = tree.ancestors(node)
            wanted |= animated.intersection(path) - bind.keys()
            if not any(step in bind or step in wanted for step in path):
                wanted.add(path[-1])
    for node in tree.order:
        if node in wanted:
            bind[node] = place_node(tree, bind, node)
    return Binding(bind, binding.world_from_mesh, binding.skin_bind)


def animated_nodes(document: Document) -> set[int]:
    """Collect the nodes whose place any clip changes."""
    channels = (channel for clip in document.gltf.animations for channel in clip.channels)
    targets = (c.target.node for c in channels if c.target.path in MOVING_PATHS)
    return {node for node in targets if node is not None}


def place_node(tree: Tree, bind: dict[int, Matrix], node: int) -> Matrix:
    """Give world_from_node in the bind pose: it keeps its place below the nearest joint."""
    joint_from_node = np.eye(4)
    for step in tree.ancestors(node):
        if step in bind:
            return bind[step] @ joint_from_node
        joint_from_node = tree.local[step] @ joint_from_node
    return joint_from_node


def place_block(document: Document, tree: Tree, binding: Binding, block: Block) -> Matrix:
    """Give world_from_mesh of a block in the bind pose."""
    skin = document.gltf.nodes[block.node].skin
    if block.is_skinned and skin is not None:
        return binding.world_from_mesh[skin]
    return place_node(tree, binding.bind, block.node)


def sort_joints(tree: Tree, nodes: set[int]) -> tuple[tuple[int, ...], Int[np.ndarray, " joints"]]:
    """Order joint nodes parents first, and give each the place of its nearest joint above."""
    joints = tuple(node for node in tree.order if node in nodes)
    place = {node: index for index, node in enumerate(joints)}
    parents = np.full(len(joints), NO_PARENT)
    for index, node in enumerate(joints):
        above = (step for step in tree.ancestors(node)[1:] if step in place)
        parents[index] = place.get(next(above, NO_PARENT), NO_PARENT)
    return joints, parents

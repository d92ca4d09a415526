"""Where the joints of a file were when its meshes were bound, in world space."""

from dataclasses import dataclass
from itertools import islice

import numpy as np
from jaxtyping import Float, Int

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.gltf.accessors import read_floats
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.geometry import Block
from bunraku.formats.gltf.placement import agree_on_placement
from bunraku.formats.gltf.tree import Tree
from bunraku.types import NO_PARENT

SAME_MATRIX = 1e-5  # of the largest number: so alike are the matrices of one joint
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
        raise document.fault(
            where, f"{len(columns)} matrices for {count} joints", code=Code.SKIN_BIND
        )
    matrices = columns[:count].reshape(-1, 4, 4).transpose(0, 2, 1).copy()
    matrices[:, 3] = 0, 0, 0, 1
    finite = (np.abs(matrices) < limits.COORDINATE).all(axis=(1, 2))
    volume = np.linalg.det(np.where(finite[:, None, None], matrices, 0.0)[:, :3, :3])
    flat = ~((np.abs(volume) > 1e-30) & (np.abs(volume) < 1e30))
    if flat.any():
        message = f"matrix {int(flat.argmax())} is NaN or cannot be inverted; bind the mesh again"
        raise document.fault(where, message, code=Code.SKIN_BIND)
    _check_doubled(document, skin, matrices)
    return matrices


def _check_doubled(
    document: Document, skin: int, matrices: Float[np.ndarray, "joints 4 4"]
) -> None:
    """Refuse a node that is twice a joint of a skin, and was bound at two places."""
    joints = document.gltf.skins[skin].joints
    place = {node: place for place, node in enumerate(joints)}
    twins = matrices[[place[node] for node in joints]]
    apart = np.abs(matrices - twins).max(axis=(1, 2)) > SAME_MATRIX * np.abs(twins).max(axis=(1, 2))
    if apart.any():
        message = f"node {joints[int(apart.argmax())]} is a joint twice, bound at two places"
        raise document.fault(
            f"/skins/{skin}/joints", f"{message}; bind the mesh again", code=Code.SKIN_JOINTS
        )


def bind_skins(document: Document, tree: Tree, blocks: list[Block]) -> Binding:
    """Find the bind pose of every joint of the skins that move something shown.

    Skins made in one pose decide together where it lies in the world. If skins were made in
    different poses, each joint is taken from the one that moves more of the mesh. In a file
    without skinned meshes, all skins count.
    """
    poses = _gather_poses(document, tree, blocks)
    bind: dict[int, Matrix] = {}
    world_from_mesh: dict[int, Matrix] = {}
    skin_bind: dict[int, Float[np.ndarray, "joints 4 4"]] = {}
    for pose in poses:
        nodes = list(pose.joint_from_pose)
        inverse_bind = np.stack([pose.joint_from_pose[node] for node in nodes])
        pose_from_joint = np.linalg.inv(inverse_bind)
        world_from_pose = agree_on_placement(
            tree.world[nodes] @ inverse_bind,
            np.array([pose.mass[node] for node in nodes]),
            pose_from_joint[:, :3, 3],
            recorded=pose.recorded,
        )
        world_from_joint = dict(zip(nodes, world_from_pose @ pose_from_joint, strict=True))
        for skin, pose_from_mesh in pose.pose_from_mesh.items():
            world_from_mesh[skin] = world_from_pose @ pose_from_mesh
            joints = document.gltf.skins[skin].joints
            skin_bind[skin] = np.stack([world_from_joint[node] for node in joints])
        bind |= _carry_over(tree, bind, world_from_joint)
    return Binding(bind, world_from_mesh, skin_bind)


@dataclass(frozen=True, eq=False)
class _Pose:
    """Skins that were bound in one pose of their joints, in the mesh space of the heaviest."""

    joint_from_pose: dict[int, Matrix]  # by node
    mass: dict[int, float]  # of each joint
    pose_from_mesh: dict[int, Matrix]  # by skin
    recorded: Matrix | None  # world_from_pose, as the node of the heaviest skin's mesh has it


def _gather_poses(document: Document, tree: Tree, blocks: list[Block]) -> list[_Pose]:
    """Put skins together that agree about the joints they share, heaviest first."""
    mass, poses = _weigh_skins(document, blocks), list[_Pose]()
    for skin in sorted(mass, key=lambda index: (-mass[index].sum(), index)):
        inverse_bind = read_inverse_bind(document, skin)
        listed = document.gltf.skins[skin].joints  # of a node that is there twice, the last counts
        joints = dict(zip(listed, inverse_bind, strict=True))
        weights = dict(zip(listed, mass[skin].tolist(), strict=True))
        for pose in poses:
            pose_from_mesh = _match_pose(pose, joints)
            if pose_from_mesh is not None:
                break
        else:
            nodes = (b.node for b in blocks if document.gltf.nodes[b.node].skin == skin)
            node = next(nodes, None)
            recorded = None if node is None else tree.world[node]
            pose, pose_from_mesh = _Pose({}, {}, {}, recorded), np.eye(4)
            poses.append(pose)
        pose.pose_from_mesh[skin] = pose_from_mesh
        mesh_from_pose = np.linalg.inv(pose_from_mesh)
        for node, joint_from_mesh in joints.items():
            pose.joint_from_pose.setdefault(node, joint_from_mesh @ mesh_from_pose)
            pose.mass[node] = pose.mass.get(node, 0.0) + weights[node]
    return poses


def _match_pose(pose: _Pose, joints: dict[int, Matrix]) -> Matrix | None:
    """Give pose_from_mesh if a skin's joints stand to each other as they do in the pose."""
    shared = [node for node in joints if node in pose.joint_from_pose]
    if not shared:
        return None
    pose_from_joint = np.linalg.inv(np.stack([pose.joint_from_pose[node] for node in shared]))
    opinions = pose_from_joint @ np.stack([joints[node] for node in shared])
    size = max(float(np.ptp(pose_from_joint[:, :3, 3], axis=0).max()), 1e-12)
    points = np.linalg.inv(joints[shared[0]])[:3, 3]
    moved = opinions[:, :3, :3] @ points + opinions[:, :3, 3]
    linear = opinions[:, :3, :3] / np.abs(opinions[0, :3, :3]).max()
    is_same = np.ptp(linear, axis=0).max() < 1e-3 and np.ptp(moved, axis=0).max() < 1e-3 * size
    return opinions[0] if is_same else None


def _carry_over(tree: Tree, bind: dict[int, Matrix], found: dict[int, Matrix]) -> dict[int, Matrix]:
    """Give the joints that only a lighter pose knows their place in the heavier ones' pose."""
    fresh: dict[int, Matrix] = {}
    for node in found.keys() - bind.keys():
        above = next(
            (step for step in tree.ancestors(node) if step in bind and step in found), None
        )
        turn = np.eye(4) if above is None else bind[above] @ np.linalg.inv(found[above])
        fresh[node] = turn @ found[node]
    return fresh


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
            path = list(tree.ancestors(node))
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
    if skin is not None and skin in binding.world_from_mesh:
        return binding.world_from_mesh[skin]
    return place_node(tree, binding.bind, block.node)


def sort_joints(tree: Tree, nodes: set[int]) -> tuple[tuple[int, ...], Int[np.ndarray, " joints"]]:
    """Order joint nodes parents first, and give each the place of its nearest joint above."""
    joints = tuple(node for node in tree.order if node in nodes)
    place = {node: index for index, node in enumerate(joints)}
    parents = np.full(len(joints), NO_PARENT)
    for index, node in enumerate(joints):
        above = (step for step in islice(tree.ancestors(node), 1, None) if step in place)
        parents[index] = place.get(next(above, NO_PARENT), NO_PARENT)
    return joints, parents

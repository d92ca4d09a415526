"""Turn the clips of a document into clips of a character's rigid joint frames.

A node carries its joint frame along: `world_from_joint(t) = world_from_node(t) @ node_from_joint`
with the constant `node_from_joint = inverse(bind) @ rest`. Between a joint and its parent joint
lies a chain of nodes, nearly always just the joint's own; what moves above a root joint is part
of the root's motion. So

    parent_from_joint(t) = parent_from_chain(t) @ parent_node_from_node(t) @ node_from_joint

where `parent_from_chain` is constant, and a similarity, in nearly every file: then translation,
rotation and scale are turned one by one, exactly; otherwise through matrices.
"""

from dataclasses import dataclass
from itertools import islice, takewhile

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.tracks import Track, Values, choose_times, read_tracks, sample_tracks
from bunraku.formats.gltf.tree import Tree
from bunraku.rotations import (
    compose_transforms,
    decompose_transforms,
    matrices_to_quaternions,
    nearest_rotation,
    quaternions_to_matrices,
)
from bunraku.types import NO_PARENT, Clip

SIMILAR = 1e-4  # how far from uniform a scale may be: files carry as much rounding as that
Samples = dict[tuple[int, str], Values]
Matrices = Float[np.ndarray, "joints 4 4"]
Vectors = Float[np.ndarray, "frames joints 3"]
Quaternions = Float[np.ndarray, "frames joints 4"]


@dataclass(frozen=True, eq=False)
class Frames:
    """The joints of a character, and how their rigid frames sit on the nodes of the file."""

    nodes: tuple[int, ...]  # parents first
    parents: Int[np.ndarray, " joints"]
    chains: tuple[tuple[int, ...], ...]  # nodes between a joint and its parent, from above
    node_from_joint: Matrices
    parent_from_chain: Matrices  # as the nodes stand by default


def build_frames(
    tree: Tree,
    nodes: tuple[int, ...],
    parents: Int[np.ndarray, " joints"],
    *,
    node_from_joint: Matrices,
) -> Frames:
    """Find the chain of nodes above each joint and what it does by default."""
    chains, above = [], np.tile(np.eye(4), (len(nodes), 1, 1))
    for joint, (node, parent) in enumerate(zip(nodes, parents, strict=True)):
        end = NO_PARENT if parent == NO_PARENT else nodes[parent]
        path = takewhile(end.__ne__, islice(tree.ancestors(node), 1, None))
        chains.append(tuple(path)[::-1])
        if parent != NO_PARENT:
            above[joint] = np.linalg.inv(node_from_joint[parent])
        for step in chains[-1]:
            above[joint] = above[joint] @ tree.local[step]
    return Frames(nodes, parents, tuple(chains), node_from_joint, above)


def read_clips(document: Document, tree: Tree, frames: Frames) -> tuple[Clip, ...]:
    """Read every clip that moves a joint, at the times of its keys.

    Raises:
        FormatError: if a clip is damaged.
    """
    between = {node for chain in frames.chains for node in chain}
    moving, clips, total = between | set(frames.nodes), [], 0
    for index, animation in enumerate(document.gltf.animations):
        if not animation.channels:
            where, code = f"/animations/{index}", Code.CLIP_CHANNEL
            document.warn(where, "has no channels: nothing moves; left out", code=code)
        tracks = read_tracks(document, index, moving)
        if tracks:
            is_bent = any(_bends(track, between) for track in tracks)
            times = choose_times(document, index, tracks, dense=is_bent)
            total += len(times) * len(frames.nodes)
            if total > limits.JOINT_FRAMES:
                message = (
                    f"clips up to this one are {total} joints times frames, at most "
                    f"{limits.JOINT_FRAMES} are read; leave some out"
                )
                raise document.fault(f"/animations/{index}", message, code=Code.LIMIT_TOTAL)
            parts = _move_joints(tree, frames, sample_tracks(tracks, times), count=len(times))
            clips.append(Clip(animation.name or f"clip_{index}", times, *parts))
    return tuple(clips)


def _bends(track: Track, between: set[int]) -> bool:
    """Tell whether a node turns or grows between two joints, so that lines are not exact."""
    return track.node in between and track.path != "translation" and not track.is_constant


def _move_joints(
    tree: Tree, frames: Frames, samples: Samples, *, count: int
) -> tuple[Vectors, Quaternions, Vectors]:
    """Give translation, rotation and scale of each joint in its parent joint's frame."""
    translations, rotations, scales = (
        np.tile(rest[list(frames.nodes)], (count, 1, 1))
        for rest in (tree.translations, tree.rotations, tree.scales)
    )
    place = {node: joint for joint, node in enumerate(frames.nodes)}
    arrays = {"translation": translations, "rotation": rotations, "scale": scales}
    for (node, path), values in samples.items():
        if node in place:
            arrays[path][:, place[node]] = values
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    simple = _move_simply(frames, translations, rotations, scales=scales)
    moved = {node for node, _ in samples}
    sheared = ~_is_simple(frames)
    for joint, chain in enumerate(frames.chains):
        if sheared[joint] or moved.intersection(chain):
            parts = _move_through(tree, frames, joint, samples=samples, count=count)
            for array, part in zip(simple, parts, strict=True):
                array[:, joint] = part
    return simple


def _is_simple(frames: Frames) -> Bool[np.ndarray, " joints"]:
    """Tell which joints have similarities around their node's own transform."""
    with np.errstate(divide="ignore", invalid="ignore"):  # axes without a size are not simple
        size = np.cbrt(np.linalg.det(frames.parent_from_chain[:, :3, :3]))
        turn = frames.parent_from_chain[:, :3, :3] / size[:, None, None]
        gap = np.abs(np.swapaxes(turn, 1, 2) @ turn - np.eye(3)).max(axis=(1, 2))
        own = frames.node_from_joint[:, 0, 0]
        own_gap = np.abs(frames.node_from_joint / own[:, None, None] - np.eye(4))[:, :3].max(
            axis=(1, 2)
        )
    return (size > 0) & (own > 0) & (gap < SIMILAR) & (own_gap < SIMILAR)


def _move_simply(
    frames: Frames, translations: Vectors, rotations: Quaternions, *, scales: Vectors
) -> tuple[Vectors, Quaternions, Vectors]:
    """Turn the three parts by the similarity above each joint."""
    linear, offset = frames.parent_from_chain[:, :3, :3], frames.parent_from_chain[:, :3, 3]
    ratio = np.cbrt(np.linalg.det(linear)) * frames.node_from_joint[:, 0, 0]
    ratio = np.where(np.abs(ratio - 1) < SIMILAR, 1.0, ratio)
    moved = np.einsum("jrc,fjc->fjr", linear, translations) + offset
    turns = nearest_rotation(linear)
    turned = rotations.copy()
    for joint in np.flatnonzero(np.abs(turns - np.eye(3)).max(axis=(1, 2)) > 1e-9):
        turn = Rotation.from_matrix(turns[joint])
        turned[:, joint] = (turn * Rotation.from_quat(rotations[:, joint])).as_quat()
    return moved, turned, scales * ratio[:, None]


def _move_through(
    tree: Tree, frames: Frames, joint: int, *, samples: Samples, count: int
) -> tuple[
    Float[np.ndarray, "frames 3"], Float[np.ndarray, "frames 4"], Float[np.ndarray, "frames 3"]
]:
    """Multiply the chain above a joint out, frame by frame; shear, if any, is dropped."""
    parent = frames.parents[joint]
    matrices = np.tile(np.eye(4), (count, 1, 1))
    if parent != NO_PARENT:
        matrices = matrices @ np.linalg.inv(frames.node_from_joint[parent])
    for node in (*frames.chains[joint], frames.nodes[joint]):
        matrices = matrices @ _node_transforms(tree, samples, node, count=count)
    moved, turned, scaled = decompose_transforms(matrices @ frames.node_from_joint[joint])
    return moved, matrices_to_quaternions(turned), scaled


def _node_transforms(
    tree: Tree, samples: Samples, node: int, *, count: int
) -> Float[np.ndarray, "frames 4 4"]:
    """Give parent_from_node in every frame."""
    if not any((node, path) in samples for path in ("translation", "rotation", "scale")):
        return np.tile(tree.local[node], (count, 1, 1))
    moved, turned, scaled = (
        samples.get((node, path), np.tile(rest[node], (count, 1)))
        for path, rest in (
            ("translation", tree.translations),
            ("rotation", tree.rotations),
            ("scale", tree.scales),
        )
    )
    return compose_transforms(moved, quaternions_to_matrices(turned), scaled)

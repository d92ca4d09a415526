"""What the route is compared with: no motion, the nearest vertex, and the figure's own rig."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from bunraku.rotations import matrices_to_quaternions, quaternions_to_matrices
from bunraku.skinning import forward_kinematics, local_transforms
from bunraku.types import Character, Clip, Mesh, Skeleton, Skin


def copy_by_name(clip: Clip, source: Skeleton, target: Skeleton, scale: float) -> Clip:
    """Play a clip on another skeleton by joint name: turns since rest as they are, moves scaled.

    Args:
        clip: a motion of the source.
        scale: the target's size over the source's.

    Returns:
        the motion of the target; joints that the source lacks keep their rest pose.
    """
    frames, joints = len(clip.times), len(target.names)
    rest = matrices_to_quaternions(target.rest[:, :3, :3])
    rotations = np.tile(rest, (frames, 1, 1))
    translations = np.tile(target.rest[:, :3, 3], (frames, 1, 1))
    scales = np.ones((frames, joints, 3))
    index = {name: i for i, name in enumerate(source.names)}
    pairs = [(index[name], i) for i, name in enumerate(target.names) if name in index]
    theirs, ours = (np.array(side, np.int64) for side in zip(*pairs, strict=True))
    turned = np.swapaxes(source.rest[theirs, :3, :3], -1, -2) @ quaternions_to_matrices(
        clip.rotations[:, theirs]
    )
    rotations[:, ours] = matrices_to_quaternions(target.rest[ours, :3, :3] @ turned)
    translations[:, ours] += scale * (clip.translations[:, theirs] - source.rest[theirs, :3, 3])
    scales[:, ours] = clip.scales[:, theirs]
    return Clip(clip.name, clip.times, translations, rotations, scales)


def own_rig(source: Character, target: Character, clips: tuple[Clip, ...]) -> Character:
    """Play the source's clips on the target's own hidden rig: about the best one can do."""
    scale = float(np.ptp(target.mesh.vertices[:, 1]) / np.ptp(source.mesh.vertices[:, 1]))
    moved = (copy_by_name(clip, source.skeleton, target.skeleton, scale) for clip in clips)
    return replace(target, clips=tuple(moved))


def fit_box(
    points: Float[np.ndarray, "points 3"],
    source: Float[np.ndarray, "source 3"],
    target: Float[np.ndarray, "target 3"],
) -> Float[np.ndarray, "points 3"]:
    """Move points as the bounding box of the source moves into that of the target."""
    lowest, extent = source.min(axis=0), np.maximum(np.ptp(source, axis=0), 1e-12)
    return (points - lowest) / extent * np.ptp(target, axis=0) + target.min(axis=0)


def nearest_vertex(source: Character, figure: Mesh, clips: tuple[Clip, ...]) -> Character:
    """Rig a figure with the weights of the nearest source vertex and the source's scaled joints.

    The source's bounding box is laid over the figure's; its joints move with the box and keep
    their axes, so that the clips play as they are.
    """
    vertices = source.mesh.vertices
    laid = fit_box(vertices, vertices, figure.vertices)
    weights = source.skin.weights[KDTree(laid).query(figure.vertices)[1]]
    world = forward_kinematics(source.skeleton.parents, source.skeleton.rest)
    world[:, :3, 3] = fit_box(world[:, :3, 3], vertices, figure.vertices)
    skeleton = replace(source.skeleton, rest=local_transforms(source.skeleton.parents, world))
    scale = float(np.ptp(figure.vertices[:, 1]) / np.ptp(vertices[:, 1]))
    moved = (copy_by_name(clip, source.skeleton, skeleton, scale) for clip in clips)
    return Character(figure, skeleton, Skin(weights, np.linalg.inv(world)), tuple(moved))

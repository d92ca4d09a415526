"""Pose a skeleton, then move a mesh with it by linear blend skinning.

    world = forward_kinematics(skeleton.parents, clip_transforms(clip))                  # Eq. 4
    moved = linear_blend_skinning(mesh.vertices, skin.weights, world @ skin.inverse_bind)

Equation numbers: Musoni et al. 2021, "Reposing and retargeting unrigged characters with
intrinsic-extrinsic transfer".
"""

import numpy as np
from jaxtyping import Float, Int

from bunraku.rotations import compose_transforms, quaternions_to_matrices
from bunraku.types import NO_PARENT, Character, Clip


def pose_joints(
    rest: Float[np.ndarray, "joints 4 4"],
    rotations: Float[np.ndarray, "*frames joints 3 3"],
) -> Float[np.ndarray, "*frames joints 4 4"]:
    """Turn every joint about its own origin, starting from the rest pose.

    Args:
        rest: parent_from_joint in the rest pose.
        rotations: rotation of each joint in its rest frame; the identity keeps the rest pose.

    Returns:
        parent_from_joint in each frame.
    """
    local = np.broadcast_to(rest, (*rotations.shape[:-2], 4, 4)).copy()
    local[..., :3, :3] = rest[:, :3, :3] @ rotations
    return local


def clip_transforms(
    clip: Clip, frames: Int[np.ndarray, " frames"] | slice = slice(None)
) -> Float[np.ndarray, "frames joints 4 4"]:
    """Build parent_from_joint of every frame of a clip (or the chosen ones) from its parts."""
    turns = quaternions_to_matrices(clip.rotations[frames])
    return compose_transforms(clip.translations[frames], turns, clip.scales[frames])


def forward_kinematics(
    parents: Int[np.ndarray, " joints"], local: Float[np.ndarray, "*frames joints 4 4"]
) -> Float[np.ndarray, "*frames joints 4 4"]:
    """Chain parent_from_joint down the tree into world_from_joint (Eq. 4)."""
    world = local.copy()
    for joint, parent in enumerate(parents):
        if parent != NO_PARENT:
            world[..., joint, :, :] = world[..., parent, :, :] @ local[..., joint, :, :]
    return world


def local_transforms(
    parents: Int[np.ndarray, " joints"], world: Float[np.ndarray, "*frames joints 4 4"]
) -> Float[np.ndarray, "*frames joints 4 4"]:
    """Undo `forward_kinematics`: world_from_joint back to parent_from_joint."""
    local = world.copy()
    child = parents != NO_PARENT
    parent_from_world = np.linalg.inv(world[..., parents[child], :, :])
    local[..., child, :, :] = parent_from_world @ world[..., child, :, :]
    return local


def linear_blend_skinning(
    vertices: Float[np.ndarray, "vertices 3"],
    weights: Float[np.ndarray, "vertices joints"],
    motion: Float[np.ndarray, "*frames joints 4 4"],
) -> Float[np.ndarray, "*frames vertices 3"]:
    """Move each vertex by the weighted mean of its joints' motions (Eq. 6).

    Args:
        vertices: the mesh in its bind pose.
        weights: share of each joint in each vertex; rows sum to 1.
        motion: world_from_world of each joint since the bind pose, world @ inverse_bind (Eq. 5).

    Returns:
        the moved vertices of each frame.

    Reference:
        Magnenat-Thalmann et al. 1988, "Joint-dependent local deformations for hand animation".
    """
    points = np.column_stack([vertices, np.ones(len(vertices))])
    moved = np.empty((*motion.shape[:-3], len(vertices), 3))
    for frame in np.ndindex(motion.shape[:-3]):  # one frame at a time keeps memory flat
        affine = weights @ motion[frame][:, :3].reshape(-1, 12)
        np.einsum("vrc,vc->vr", affine.reshape(-1, 3, 4), points, out=moved[frame])
    return moved


def play_clip(
    character: Character, clip: Clip, frames: Int[np.ndarray, " frames"] | slice = slice(None)
) -> Float[np.ndarray, "frames vertices 3"]:
    """Give the character's vertices at each frame of a clip (or at the chosen frames)."""
    world = forward_kinematics(character.skeleton.parents, clip_transforms(clip, frames))
    motion = world @ character.skin.inverse_bind
    return linear_blend_skinning(character.mesh.vertices, character.skin.weights, motion)


def keep_influences(
    weights: Float[np.ndarray, "vertices joints"], count: int = 4
) -> Float[np.ndarray, "vertices joints"]:
    """Keep the `count` largest weights of each vertex and make every row sum to 1.

    Raises:
        ValueError: if a vertex has no positive weight.
    """
    kept = np.clip(weights, 0.0, None)
    if count < weights.shape[1]:
        smallest = np.argpartition(kept, -count, axis=1)[:, :-count]
        np.put_along_axis(kept, smallest, 0.0, axis=1)
    total = kept.sum(axis=1, keepdims=True)
    if (total == 0).any():
        raise ValueError(f"vertex {int(total.argmin())} has no positive skinning weight")
    return kept / total

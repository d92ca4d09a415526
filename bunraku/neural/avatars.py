"""An avatar at rest and posed, understood: a character whose clip are the poses."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from bunraku.bones.decomposition import fit_motions, fit_weights
from bunraku.meshes import vertex_areas
from bunraku.neural.parts import Understanding
from bunraku.rotations import (
    compose_transforms,
    invert_rigid,
    matrices_to_quaternions,
    matrices_to_vectors,
    nearest_rotation,
    rotation_angles,
    rotation_between,
    vectors_to_matrices,
)
from bunraku.skinning import keep_influences, linear_blend_skinning, local_transforms
from bunraku.types import NO_PARENT, Character, Clip, Mesh, Skeleton, Skin

CLIP = "pose"  # name of the clip of an avatar's poses
SAMPLES = 3000  # vertices that tell how parts turn
LEAST_SHARE = 2e-3  # of the surface; smaller parts turn with their parents
PRIOR = 2e-6  # pull towards the parent's turn, in squared heights times shares of the surface
ROUNDS = 2  # of fitting all parts together, blended as skinning blends them
HELD = 5e-3  # squared radians
WRONG = 5e-3  # of the size: how far off vertices are whose part is doubted
TOLD = 24  # poses that tell how wrong weights are
LIMB_TURNED = 17.0, 27.0  # degrees between two limbs at rest: shape below, pose above

Poses = Float[np.ndarray, "frames vertices 3"]
Turns = Float[np.ndarray, "frames parts 3 3"]
Shifts = Float[np.ndarray, "frames parts 3"]


def rig_avatar(
    avatar: Mesh, poses: Poses, seen: Understanding, *, times: Float[np.ndarray, " frames"]
) -> Character:
    """Rig an avatar with the parts it was seen to have; its poses become a clip.

    Args:
        avatar: at rest.
        poses: its vertices in each pose.
        seen: its parts and joints.
        times: of the poses, in seconds, rising.

    Returns:
        a character whose joint frames are aligned with the world at rest.
    """
    turns, shifts = follow_parts(avatar, poses, seen)
    seen = replace(seen, weights=mend_weights(avatar, poses, seen, turns, shifts))
    turns, shifts = follow_parts(avatar, poses, seen)
    seen = replace(seen, joints=settle_joints(seen.joints, seen.anatomy.parents, turns, shifts))
    return as_character(avatar, seen, turns, shifts, times)


def as_character(
    mesh: Mesh,
    seen: Understanding,
    turns: Turns,
    shifts: Shifts,
    times: Float[np.ndarray, " frames"],
) -> Character:
    """Make a character of parts and their rigid motions since rest: x goes to turn x + shift.

    A joint goes where its part takes it, even if that is not quite where its parent does.
    """
    anatomy, joints, parents = seen.anatomy, seen.joints, seen.anatomy.parents
    bind = compose_transforms(joints, np.broadcast_to(np.eye(3), (len(joints), 3, 3)))
    skeleton = Skeleton(anatomy.names, parents, local_transforms(parents, bind))
    moved = np.einsum("fkab,kb->fka", turns, joints) + shifts
    local = local_transforms(parents, compose_transforms(moved, turns))
    quaternions = matrices_to_quaternions(local[..., :3, :3])
    places = local[..., :3, 3].copy()
    clip = Clip(CLIP, times, places, quaternions, np.ones_like(places))
    skin = Skin(keep_influences(seen.weights), invert_rigid(bind))
    return Character(mesh, skeleton, skin, (clip,))


def settle_joints(
    joints: Float[np.ndarray, "parts 3"],
    parents: Int[np.ndarray, " parts"],
    turns: Turns,
    shifts: Shifts,
    *,
    held: float = HELD,
) -> Float[np.ndarray, "parts 3"]:
    """Move each joint to where its part and its parent's agree in all poses.

    min_j mean_f |(R_k - R_p) j + t_k - t_p|^2 + held |j - found|^2: what no pose tells of a joint,
    such as its place along the axis it turned about, stays as it was found.

    Args:
        turns, shifts: rigid motion of each part since rest.
        held: squared radians of turning at which the network and the motion are believed alike.
    """
    settled = joints.copy()
    for part, parent in enumerate(parents):
        if parent == NO_PARENT:
            continue
        turn = turns[:, part] - turns[:, parent]
        gap = np.einsum("fab,b->fa", turn, joints[part]) + shifts[:, part] - shifts[:, parent]
        normal = np.einsum("fab,fac->bc", turn, turn) / len(turn) + held * np.eye(3)
        wanted = np.einsum("fab,fa->b", turn, gap) / len(turn)
        settled[part] -= np.linalg.solve(normal, wanted)
    return settled


def mend_weights(
    avatar: Mesh, poses: Poses, seen: Understanding, turns: Turns, shifts: Shifts
) -> Float[np.ndarray, "vertices parts"]:
    """Give vertices that do not go with their parts to those parts that they do go with.

    What an avatar carries is easily taken for a wrong part; its motion tells.
    """
    frames = np.unique(np.linspace(0, len(poses) - 1, TOLD).astype(np.int64))
    paths, rotations, moved = poses[frames], turns[frames], shifts[frames]
    near = np.ones((len(avatar.vertices), turns.shape[1]), bool)
    fitted = fit_weights(avatar.vertices, paths, rotations, moved, near)
    motion = compose_transforms(moved, rotations)
    before, after = (
        np.linalg.norm(linear_blend_skinning(avatar.vertices, w, motion) - paths, axis=-1).max(0)
        for w in (seen.weights, fitted)
    )
    wrong = before > WRONG * float(np.ptp(avatar.vertices, axis=0).max())
    return np.where((wrong & (after < 0.5 * before))[:, None], fitted, seen.weights)


def follow_parts(avatar: Mesh, poses: Poses, seen: Understanding) -> tuple[Turns, Shifts]:
    """Find the rigid motion of each part from rest to each pose: turns and shifts.

    A rigid motion a part (Procrustes), small parts held to their parents; then all together, so
    that what two parts share between them is explained by both.
    """
    rng = np.random.default_rng(0)
    chosen = _spread_vertices(avatar, rng)
    rest, moved, weights = avatar.vertices[chosen], poses[:, chosen], seen.weights[chosen]
    parents = seen.anatomy.parents
    size = float(np.ptp(rest, axis=0).max())
    rotations, shifts = rigid_parts(rest, moved, weights, parents, prior=PRIOR * size**2)
    for _ in range(ROUNDS):
        fitted = fit_motions(rest, moved, weights, rotations, shifts)
        large = weights.mean(axis=0) > 5 * LEAST_SHARE
        rotations = np.where(large[:, None, None], fitted[0], rotations)
        shifts = np.where(large[:, None], fitted[1], shifts)
    return rotations, shifts


def _spread_vertices(mesh: Mesh, rng: np.random.Generator) -> Int[np.ndarray, " chosen"]:
    """Choose vertices, each as likely as its share of the surface."""
    count = len(mesh.vertices)
    if not len(mesh.faces):
        return rng.choice(count, min(SAMPLES, count), replace=False)
    areas = vertex_areas(mesh.vertices, mesh.faces)
    return rng.choice(count, SAMPLES, p=areas / areas.sum())


def rigid_parts(
    rest: Float[np.ndarray, "vertices 3"],
    moved: Poses,
    weights: Float[np.ndarray, "vertices parts"],
    parents: Int[np.ndarray, " parts"],
    *,
    prior: float,
) -> tuple[Turns, Shifts]:
    """Fit a rigid motion to each part, most of all where it is alone (weights squared).

    Args:
        prior: how strongly a part turns as its parent does.
    """
    frames, parts = len(moved), weights.shape[1]
    rotations = np.tile(np.eye(3), (frames, parts, 1, 1))
    shifts = np.zeros((frames, parts, 3))
    for part, parent in enumerate(parents):
        share = weights[:, part] ** 2 / len(rest)
        total = float(share.sum())
        above = rotations[:, parent] if parent != NO_PARENT else rotations[:, part]
        if total < LEAST_SHARE / 4 and parent != NO_PARENT:
            rotations[:, part], shifts[:, part] = above, shifts[:, parent]
            continue
        centre, goal = share @ rest / total, np.einsum("v,fva->fa", share, moved) / total
        arms = share[:, None] * (rest - centre)
        product = np.einsum("fva,vb->fab", moved - goal[:, None], arms)
        rotations[:, part] = nearest_rotation(product + prior * above)
        shifts[:, part] = goal - rotations[:, part] @ centre
    return rotations, shifts


def rest_difference(avatar: Understanding, figure: Understanding) -> Float[np.ndarray, "parts 3 3"]:
    """Find how a figure's limbs at rest are turned from the avatar's (T against A pose).

    Small differences are shape, large ones pose; only people's arms and everybody's legs count,
    and each of their bones turns for itself.
    """
    anatomy = avatar.anatomy
    turns = np.tile(np.eye(3), (len(anatomy.names), 1, 1))
    for first, second, third in limbs(anatomy.names):
        whole = [u.joints[third] - u.joints[first] for u in (avatar, figure)]
        angle = np.degrees(float(rotation_angles(rotation_between(whole[0], whole[1]))))
        belief = float(np.clip((angle - LIMB_TURNED[0]) / np.ptp(LIMB_TURNED), 0, 1))
        for part, after in ((first, second), (second, third)):
            bones = [u.joints[after] - u.joints[part] for u in (avatar, figure)]
            turn = matrices_to_vectors(rotation_between(bones[0], bones[1]))
            turns[part] = vectors_to_matrices(belief * turn)
        turns[third] = turns[second]
    return turns


def unlikeness(avatar: Understanding, figure: Understanding) -> float:
    """Measure how far two bodies' proportions differ: the mean log ratio of their bones' lengths.

    As wholes they count as equally large; long bones count most. Of builds of people .04 to .07,
    of people stylised .07 to .13, of two chibis of one pack .22, of a dog and a hippo .4.
    """
    parents, lengths = avatar.anatomy.parents[1:], []
    for seen in (avatar, figure):
        bones = np.linalg.norm(seen.joints[1:] - seen.joints[parents], axis=1)
        lengths.append(bones / max(float(bones.sum()), 1e-9))
    short = 0.1 / len(parents)  # a tenth of the mean: shorter bones are noise
    ratios = np.log((lengths[1] + short) / (lengths[0] + short))
    share = lengths[0] + lengths[1]
    return float((share * np.abs(ratios - np.median(ratios))).sum() / share.sum())


def limbs(names: tuple[str, ...]) -> list[tuple[int, int, int]]:
    """List the limbs of three parts each: arms and legs, or four legs."""
    found = []
    for part, name in enumerate(names):
        if name.endswith(("UpperArm", "UpperLeg")):
            found.append((part, part + 1, part + 2))
    return found

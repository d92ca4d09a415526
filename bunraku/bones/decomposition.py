"""Skinning decomposition: weights and bone motions that explain a moving surface (SSDR).

After Le and Deng 2012, "Smooth skinning decomposition with rigid bones", started from given bones
and keeping them (Transfer4D, Sec. 4.4, Eqs. 10-13).
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.bones.splitting import fit_rigid
from bunraku.rotations import nearest_rotation

INFLUENCES = 4
Paths = Float[np.ndarray, "frames vertices 3"]
Rotations = Float[np.ndarray, "frames bones 3 3"]
Shifts = Float[np.ndarray, "frames bones 3"]
Weights = Float[np.ndarray, "vertices bones"]


def decompose(
    rest: Float[np.ndarray, "vertices 3"],
    paths: Paths,
    owners: Int[np.ndarray, " vertices"],
    parents: Int[np.ndarray, " bones"],
    *,
    rounds: int = 3,
) -> tuple[Weights, Rotations, Shifts]:
    """Fit weights (at most four a vertex) and rigid bone motions to a moving surface.

    Args:
        rest: the surface where nothing has moved.
        paths: the same vertices in every frame.
        owners: the bone each vertex begins with.
        parents: tree of the bones; a vertex follows only bones at most two steps from its first.

    Returns:
        weights, and each bone's motion since rest.
    """
    count = len(parents)
    weights = np.eye(count)[owners]
    fitted = [fit_rigid(rest, paths, weights[:, bone]) for bone in range(count)]
    rotations = np.stack([rotation for rotation, _ in fitted], axis=1)
    shifts = np.stack([shift for _, shift in fitted], axis=1)
    near = neighbourhood(parents)[owners]
    for _ in range(rounds):
        weights = fit_weights(rest, paths, rotations, shifts, near)
        rotations, shifts = fit_motions(rest, paths, weights, rotations, shifts)
    return weights, rotations, shifts


def neighbourhood(
    parents: Int[np.ndarray, " bones"], *, steps: int = 2
) -> Bool[np.ndarray, "bones bones"]:
    """Tell which bones are at most so many steps apart in the tree; siblings are one apart."""
    count = len(parents)
    touching = np.eye(count, dtype=bool)
    child = np.flatnonzero(parents >= 0)
    touching[child, parents[child]] = touching[parents[child], child] = True
    near = touching.copy()
    for _ in range(steps - 1):
        near = near @ touching
    return near


def fit_weights(
    rest: Float[np.ndarray, "vertices 3"],
    paths: Paths,
    rotations: Rotations,
    shifts: Shifts,
    near: Bool[np.ndarray, "vertices bones"],
    *,
    steps: int = 60,
) -> Weights:
    """Find each vertex's best convex weights on the four bones that err least (Eqs. 11-13)."""
    count = rotations.shape[1]
    errors = np.empty((len(rest), count))
    for bone in range(count):
        moved = np.einsum("fab,vb->fva", rotations[:, bone], rest) + shifts[:, bone, None]
        errors[:, bone] = ((moved - paths) ** 2).sum(axis=(0, 2))
    errors[~near] = np.inf
    few = min(INFLUENCES, count)
    chosen = np.argsort(errors, axis=1)[:, :few]
    allowed = np.isfinite(np.take_along_axis(errors, chosen, axis=1))
    gram = np.zeros((len(rest), few, few))
    for rotation, shift, place in zip(rotations, shifts, paths, strict=True):
        moved = np.einsum("vkab,vb->vka", rotation[chosen], rest) + shift[chosen]
        off = moved - place[:, None]
        gram += off @ np.swapaxes(off, 1, 2)
    gram[:, np.arange(few), np.arange(few)] += 1e-9 + 1e3 * ~allowed
    found = simplex_minimum(gram, steps)
    weights = np.zeros((len(rest), count))
    np.put_along_axis(weights, chosen, found, axis=1)
    return weights


def simplex_minimum(
    gram: Float[np.ndarray, "vertices few few"], steps: int
) -> Float[np.ndarray, "vertices few"]:
    """Minimise w^T G w over w >= 0, sum w = 1, by projected gradient steps."""
    few = gram.shape[1]
    weights = np.zeros((len(gram), few))
    weights[:, 0] = 1.0
    length = 1.0 / np.maximum(np.trace(gram, axis1=1, axis2=2), 1e-12)
    for _ in range(steps):
        weights = weights - length[:, None] * np.einsum("vkl,vl->vk", gram, weights)
        weights = project_on_simplex(weights)
    weights[weights < 1e-3] = 0.0
    normed: np.ndarray = weights / weights.sum(axis=1, keepdims=True)
    return normed


def project_on_simplex(
    weights: Float[np.ndarray, "vertices few"],
) -> Float[np.ndarray, "vertices few"]:
    """Give the nearest weights that are >= 0 and sum to 1 (Duchi et al. 2008)."""
    falling = -np.sort(-weights, axis=1)
    excess = np.cumsum(falling, axis=1) - 1.0
    number = np.arange(1, weights.shape[1] + 1)
    last = (falling - excess / number > 0).sum(axis=1) - 1
    level = np.take_along_axis(excess / number, last[:, None], axis=1)
    return np.maximum(weights - level, 0.0)


def fit_motions(
    rest: Float[np.ndarray, "vertices 3"],
    paths: Paths,
    weights: Weights,
    rotations: Rotations,
    shifts: Shifts,
) -> tuple[Rotations, Shifts]:
    """Update each bone's motion in turn, from what the others leave of the surface's."""
    rotations, shifts = rotations.copy(), shifts.copy()
    affine = np.concatenate([rotations, shifts[..., None]], axis=-1)
    points = np.column_stack([rest, np.ones(len(rest))])
    left = paths - np.einsum("fvac,vc->fva", blend(weights, affine), points)
    for bone in range(weights.shape[1]):
        carried = np.flatnonzero(weights[:, bone] > 1e-4)
        if len(carried) < 4:
            continue
        weight = weights[carried, bone]
        own = np.einsum("fab,vb->fva", affine[:, bone], points[carried])
        wanted = left[:, carried] + weight[:, None] * own  # = weight * where it should go
        centre = (weight**2 @ rest[carried]) / (weight**2).sum()
        goal = np.einsum("v,fva->fa", weight, wanted) / (weight**2).sum()
        arms = weight[:, None] * (rest[carried] - centre)
        product = np.einsum("fva,vb->fab", wanted - weight[:, None] * goal[:, None], arms)
        rotations[:, bone] = nearest_rotation(product + 1e-9 * rotations[:, bone])
        shifts[:, bone] = goal - rotations[:, bone] @ centre
        affine[:, bone] = np.concatenate([rotations[:, bone], shifts[:, bone, :, None]], axis=-1)
        now = np.einsum("fab,vb->fva", affine[:, bone], points[carried])
        left[:, carried] = wanted - weight[:, None] * now
    return rotations, shifts


def blend(
    weights: Weights, affine: Float[np.ndarray, "frames bones 3 4"]
) -> Float[np.ndarray, "frames vertices 3 4"]:
    """Mix bone motions by weights."""
    frames, bones = affine.shape[:2]
    mixed = weights @ affine.transpose(1, 0, 2, 3).reshape(bones, -1)
    return mixed.reshape(len(weights), frames, 3, 4).transpose(1, 0, 2, 3)


def joint_paths(
    rest: Float[np.ndarray, "vertices 3"],
    weights: Weights,
    rotations: Rotations,
    shifts: Shifts,
    rings: Bool[np.ndarray, "bones vertices"],
    joints: Float[np.ndarray, "bones 3"],
) -> Float[np.ndarray, "frames bones 3"]:
    """Move each joint as its ring of vertices moves on average (Eq. 14).

    Paper: a sum over the ring; it must be the mean. A joint without a ring moves with its bone.
    """
    alone = rings.sum(axis=1) == 0
    share = rings / np.maximum(rings.sum(axis=1, keepdims=True), 1)
    affine = np.concatenate([rotations, shifts[..., None]], axis=-1)
    points = np.column_stack([rest, np.ones(len(rest))])
    moved = np.einsum("fvac,vc->fva", blend(weights, affine), points)
    carried = joints + np.einsum("jv,fva->fja", share, moved - rest)
    by_bone = np.einsum("fjac,jc->fja", affine, np.column_stack([joints, np.ones(len(joints))]))
    return np.where(alone[:, None], by_bone, carried)

"""Find where a skinned mesh lies in the world when its joints' present pose is not its bind pose.

Every joint has an opinion, `world_from_mesh = world_from_joint @ inverse_bind`. They agree when
the file stands in its bind pose. When arms hang down in a file bound in a T pose, the trunk and
the head still agree: most of the body's mass decides. glTF ignores the transform of a skinned
mesh's own node, but exporters leave in it where the mesh was when it was bound: if its scale is
the joints' own, and most joints do not contradict it, that is the better witness.
"""

from itertools import permutations, product

import numpy as np
from jaxtyping import Float

from bunraku.rotations import (
    compose_transforms,
    decompose_transforms,
    nearest_rotation,
    rotation_angles,
    vectors_to_matrices,
)

AGREED_ANGLE, CLEAN_ANGLE, ALIKE_ANGLE = np.radians((5.0, 6.0, 15.0))
SAME_SCALE, MAJORITY = 0.01, 0.5
CLEAR_VOTE = 0.5  # of 4, the difference in trace between opposite headings


def agree_on_placement(
    opinions: Float[np.ndarray, "joints 4 4"],
    mass: Float[np.ndarray, " joints"],
    points: Float[np.ndarray, "joints 3"],
    *,
    recorded: Float[np.ndarray, "4 4"] | None = None,
) -> Float[np.ndarray, "4 4"]:
    """Give the one world_from_mesh that joints with their opinions on it agree on best.

    Args:
        opinions: world_from_mesh of each joint.
        mass: how much of the mesh each joint moves; joints without mass have no say.
        points: a point of each joint in the mesh's space, where its opinion counts.
        recorded: world_from_node of the mesh's own node.

    Returns:
        the opinion itself, if there is only one; else `recorded`, if it is credible; else a
        similarity: the median scale, the rotation most of the mass shares (along the axes, if it
        nearly is), the median offset.
    """
    mass = mass if mass.sum() > 0 else np.ones(len(opinions))
    moved = np.einsum("jrc,jc->jr", opinions[:, :3, :3], points) + opinions[:, :3, 3]
    heaviest = opinions[int(mass.argmax())]
    expected = points @ heaviest[:3, :3].T + heaviest[:3, 3]
    size = max(float(np.ptp(expected, axis=0).max()), 1e-12)
    linear_gap = np.abs(opinions - heaviest)[:, :3, :3].max() / np.abs(heaviest[:3, :3]).max()
    if linear_gap < 1e-3 and np.abs(moved - expected).max() < 1e-3 * size:
        return heaviest
    _, rotations, scales = decompose_transforms(opinions)
    scale = _weighted_median(np.abs(scales).prod(axis=1) ** (1 / 3), mass)
    rotation, friends = _shared_rotation(rotations, mass)
    offsets = moved - scale * points @ rotation.T
    offset = np.array([_weighted_median(axis[friends], mass[friends]) for axis in offsets.T])
    agreed = compose_transforms(offset, rotation, np.full(3, scale))
    share = float(mass[friends].sum() / mass.sum())
    if recorded is not None and _is_credible(recorded, agreed, share=share):
        return _turn_to_heading(recorded, rotations, mass)
    return agreed


def _turn_to_heading(
    recorded: Float[np.ndarray, "4 4"],
    rotations: Float[np.ndarray, "joints 3 3"],
    mass: Float[np.ndarray, " joints"],
) -> Float[np.ndarray, "4 4"]:
    """Turn a placement by quarters about the vertical, if the joints clearly face elsewhere."""
    upright = decompose_transforms(recorded)[1]
    quarters = vectors_to_matrices(np.outer(np.arange(4), (0.0, np.pi / 2, 0.0)))
    votes = np.einsum("j,jrc,krc->k", mass, rotations, quarters @ upright) / mass.sum()
    best = int(votes.argmax())
    if votes[best] - votes[0] < CLEAR_VOTE:
        return recorded
    turned = recorded.copy()
    turned[:3, :3] = quarters[best] @ recorded[:3, :3]
    return turned


def _is_credible(
    recorded: Float[np.ndarray, "4 4"], agreed: Float[np.ndarray, "4 4"], *, share: float
) -> bool:
    """Tell whether a mesh node's transform has the joints' scale and they do not outvote it.

    A pose turns joints by any angle; axes that were mixed up turn most of them by quarters.
    """
    _, rotation, scale = decompose_transforms(recorded)
    _, voted, wanted = decompose_transforms(agreed)
    if not wanted.all():
        return True  # joints that most of the mesh follows have no size: they know nothing
    if float(np.abs(scale / wanted - 1).max()) > SAME_SCALE:
        return False
    turn = rotation.T @ voted
    is_alike = float(rotation_angles(turn)) < ALIKE_ANGLE
    is_quarter = float(rotation_angles(_nearest_clean(turn).T @ turn)) < CLEAN_ANGLE
    return bool(share < MAJORITY or is_alike or not is_quarter)


def _shared_rotation(
    rotations: Float[np.ndarray, "joints 3 3"], mass: Float[np.ndarray, " joints"]
) -> tuple[Float[np.ndarray, "3 3"], np.ndarray]:
    """Find the rotation that the most mass is close to, and which joints those are."""
    trace = np.einsum("irc,jrc->ij", rotations, rotations)
    is_close = trace > 1 + 2 * np.cos(AGREED_ANGLE)
    friends = is_close[int((is_close @ mass).argmax())] & (mass > 0)
    mean = nearest_rotation(np.einsum("j,jrc->rc", mass[friends], rotations[friends]))
    nearest = _nearest_clean(mean)
    is_clean = float(rotation_angles(nearest.T @ mean)) < CLEAN_ANGLE
    return (nearest if is_clean else mean), friends


def _nearest_clean(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Find the nearest of the 24 rotations that map the axes onto each other."""
    matrices = [
        np.eye(3)[list(order)] * signs
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    clean = np.array([matrix for matrix in matrices if np.linalg.det(matrix) > 0])
    return clean[np.einsum("krc,rc->k", clean, rotation).argmax()]


def _weighted_median(values: Float[np.ndarray, " n"], mass: Float[np.ndarray, " n"]) -> float:
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(mass[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2)])

"""What a character's clips tell of its joints: which way and how far each one turns.

A knee bends about one axis, a shoulder blade hardly turns at all. A fit that knows this puts a
turn where the character itself would, and does not share it out among the joints of a limb.
"""

import numpy as np
from jaxtyping import Float, Int

USUAL = np.deg2rad(20.0)  # turn that costs as much as one of a joint of which nothing is known
LEAST = np.deg2rad(8.0)  # spread that every joint has beside what its clips show


def joint_stiffness(
    turns: Float[np.ndarray, "moments joints 3"],
) -> Float[np.ndarray, "joints 3 3"]:
    """Give the cost of a turn of each joint: one over the spread of its turns in the clips.

    Clips in which no joint but the root turns by USUAL, a character that only breathes, or is
    carried about, tell little: their spread is mixed with the usual one.

    Args:
        turns: rotation vectors of each joint, root first, in its parent's frame at moments of
            the clips.

    Returns:
        a positive definite matrix per joint; the identity where there are no clips.
    """
    moments, joints, _ = turns.shape
    if not moments:
        return np.tile(np.eye(3), (joints, 1, 1))
    spread = np.einsum("mja,mjb->jab", turns, turns) / moments
    told = min(1.0, float(np.linalg.eigvalsh(spread[1:]).max(initial=0.0)) / USUAL**2)
    usual = ((1.0 - told) * USUAL**2 + LEAST**2) * np.eye(3)
    return np.asarray(USUAL**2 * np.linalg.inv(told * spread + usual))


def turns_at_moments(
    world: Float[np.ndarray, "moments joints 3 3"], parents: Int[np.ndarray, " joints"]
) -> Float[np.ndarray, "moments joints 3 3"]:
    """Turn world rotations since rest into each joint's own, in its parent's frame."""
    still = np.tile(np.eye(3), (len(world), 1, 1, 1))
    above = np.concatenate([still, world], axis=1)[:, parents + 1]
    return np.asarray(np.swapaxes(above, 2, 3) @ world)

"""Find the figure's rest pose: its joints where the source's rest pose has them, without twist.

[IE] Musoni et al. 2021, Sec. 4.2, Eqs. 11-12; with `surface_turns`, our addition that answers the
limitation the paper names: twist about a bone, invisible in joints, is read off the surface.
"""

import numpy as np
from jaxtyping import Float, Int

from bunraku.graphs import descendants, root_first
from bunraku.rotations import matrices_to_vectors, vectors_to_matrices
from bunraku.types import NO_PARENT

# Paper: one growing lambda, values not given. We: four rounds of Gauss-Newton, in units of a
# skeleton 1.7 m high, because ending stiffer than 1e-3 leaves the limbs half way.
GROWING = (1e-4, 1e-4, 3e-4, 1e-3)


def goal_joints(
    joints: Float[np.ndarray, "joints 3"],
    rest: Float[np.ndarray, "joints 3"],
    parents: Int[np.ndarray, " joints"],
) -> Float[np.ndarray, "joints 3"]:
    """Build the goal skeleton: the source's bone directions with the figure's bone lengths.

    Where the source's bone has no length, and so no direction, the figure's own is kept.
    """
    goal = joints.copy()
    least = 1e-6 * float(np.ptp(rest, axis=0).max())
    for joint in root_first(parents):
        parent = parents[joint]
        if parent != NO_PARENT:
            bone, own = rest[joint] - rest[parent], joints[joint] - joints[parent]
            length = float(np.linalg.norm(bone))
            stretch = float(np.linalg.norm(own)) / max(length, 1e-300)
            goal[joint] = goal[parent] + (bone * stretch if length > least else own)
    return goal


def place_joints(
    joints: Float[np.ndarray, "joints 3"],
    parents: Int[np.ndarray, " joints"],
    turns: Float[np.ndarray, "joints 3 3"],
    shift: Float[np.ndarray, "3"],
) -> tuple[Float[np.ndarray, "joints 3"], Float[np.ndarray, "joints 3 3"]]:
    """Turn every joint of a skeleton in its parent's frame; give places and world turns."""
    world, placed = turns.copy(), joints + shift
    for joint in root_first(parents):
        parent = parents[joint]
        if parent != NO_PARENT:
            world[joint] = world[parent] @ turns[joint]
            placed[joint] = placed[parent] + world[parent] @ (joints[joint] - joints[parent])
    return placed, world


def recover_rest_pose(
    joints: Float[np.ndarray, "joints 3"],
    rest: Float[np.ndarray, "joints 3"],
    parents: Int[np.ndarray, " joints"],
    *,
    surface_turns: Float[np.ndarray, "joints 3 3"] | None = None,
    trust: Float[np.ndarray, " joints"] | None = None,
    growing: tuple[float, ...] = GROWING,
) -> Float[np.ndarray, "joints 3 3"]:
    """Turn a figure's joints into the source's rest pose (Eqs. 11-12).

    Paper: plain norms and an optimiser not named. We: least squares and Gauss-Newton; the root
    turns freely; the goal has the figure's own bone lengths.

    Args:
        joints: of the figure, as found.
        rest: of the source, at rest.
        parents: the tree of both.
        surface_turns: world rotation of each joint's surface from the source's rest to the
            figure as found; None leaves twist to the regulariser, as in the paper.
        trust: weight of each surface turn beside the joints, 0 where no surface was seen.
        growing: lambda of each round of eight steps.

    Returns:
        world rotation of each joint from the figure as found to its rest pose.
    """
    extent = float(np.ptp(rest, axis=0).max())
    size = 1.7 / extent if extent > 0 else 1.0
    goal = goal_joints(joints, rest, parents) * size
    own = joints * size
    count = len(parents)
    turns, shift = np.tile(np.eye(3), (count, 1, 1)), np.zeros(3)
    if surface_turns is not None:
        turns = local_turns(np.swapaxes(surface_turns, 1, 2), parents)
    trust = np.zeros(count) if trust is None or surface_turns is None else trust
    surface_turns = np.tile(np.eye(3), (count, 1, 1)) if surface_turns is None else surface_turns
    below = descendants(parents)
    for stiffness in np.repeat(growing, 8):
        placed, world = place_joints(own, parents, turns, shift)
        hessian, gradient = linearise_joints(placed, goal, below)
        unseen = matrices_to_vectors(world @ surface_turns)
        add_turn_costs(hessian, gradient, below=below, unseen=unseen, trust=trust)
        above = np.concatenate([np.eye(3)[None], world])[parents + 1]
        bent = np.einsum("jab,jb->ja", above, matrices_to_vectors(turns))
        cost = np.repeat(np.where(parents == NO_PARENT, 0.0, stiffness), 3)
        gradient[:-3] -= cost * bent.ravel()
        hessian[np.arange(3 * count), np.arange(3 * count)] += cost + 1e-9
        step = np.linalg.solve(hessian + 1e-9 * np.eye(len(hessian)), gradient)
        step *= min(1.0, 0.6 / max(float(np.abs(step).max()), 1e-12))
        change = vectors_to_matrices(step[:-3].reshape(-1, 3))
        turns = np.swapaxes(above, 1, 2) @ change @ above @ turns
        shift = shift + step[-3:]
    return place_joints(own, parents, turns, shift)[1]


def linearise_joints(
    placed: Float[np.ndarray, "joints 3"],
    goal: Float[np.ndarray, "joints 3"],
    below: np.ndarray,
) -> tuple[Float[np.ndarray, "unknowns unknowns"], Float[np.ndarray, " unknowns"]]:
    """Build the normal equations of joint places by world turns and the root's shift (Eq. 11).

    For a turn w of joint j, joint k below it moves by w x (P_k - P_j).
    """
    count = len(placed)
    lever = (placed[None] - placed[:, None]) * below[:, :, None]  # turning joint, moved joint
    jacobian = np.zeros((count, 3, 3 * count + 3))
    for axis in range(3):
        moved = np.cross(np.eye(3)[axis], lever)
        jacobian[:, :, axis : 3 * count : 3] = moved.transpose(1, 2, 0)
    jacobian[:, :, 3 * count :] = np.eye(3)
    flat = jacobian.reshape(3 * count, -1)
    return flat.T @ flat / count, flat.T @ (goal - placed).ravel() / count


def add_turn_costs(
    hessian: Float[np.ndarray, "unknowns unknowns"],
    gradient: Float[np.ndarray, " unknowns"],
    *,
    below: np.ndarray,
    unseen: Float[np.ndarray, "joints 3"],
    trust: Float[np.ndarray, " joints"],
) -> None:
    """Add, in place, trust * |turn left between joint and surface|^2 of every joint."""
    share = (below * trust) @ below.T.astype(np.float64)  # of pairs of turning joints
    hessian[:-3, :-3] += np.kron(share, np.eye(3)) / len(trust)
    gradient[:-3] -= ((below * trust) @ unseen).ravel() / len(trust)


def local_turns(
    world: Float[np.ndarray, "joints 3 3"], parents: Int[np.ndarray, " joints"]
) -> Float[np.ndarray, "joints 3 3"]:
    """Turn world rotations into turns in the parent's frame."""
    above = np.concatenate([np.eye(3)[None], world])[parents + 1]
    return np.swapaxes(above, 1, 2) @ world

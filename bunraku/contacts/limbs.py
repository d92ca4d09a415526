"""Bend a limb of two parts so that its end meets a goal: analytic, bones as long as before."""

import numpy as np
from jaxtyping import Float

from bunraku.rotations import rotation_between, vectors_to_matrices

STRAIGHT = 0.05  # sine of the bend below which the plane of bending is taken from other frames
SLACKENS = 0.97  # of its length, from which a limb straightens ever more slowly
NEAREST = 1e-3  # of its upper part: a foot is never pulled into the hip
FARTHEST = 0.999  # of its length: a limb is never pulled quite straight

Points = Float[np.ndarray, "frames 3"]
Turns = Float[np.ndarray, "frames 3 3"]


def bending_axes(hip: Points, knee: Points, foot: Points, turns: Turns, ahead: Points) -> Points:
    """Give the unit axis about which each frame's limb bends: the normal of its plane.

    A limb that is nearly straight has no plane: it takes the mean one of all frames, in the
    frame of its upper part; one that never bends, the one whose knee points ahead.

    Args:
        hip: where the limb hangs; `knee` and `foot` further down.
        turns: world rotation of the upper part, in each frame.
        ahead: a direction in the world for knees that never bend.
    """
    upper, lower = knee - hip, foot - knee
    normal = np.cross(upper, lower)
    reach = np.linalg.norm(upper, axis=1) * np.linalg.norm(lower, axis=1)
    normal /= np.maximum(reach, 1e-12)[:, None]
    local = np.einsum("fba,fb->fa", turns, normal).mean(axis=0)
    usual = turns @ local
    if np.linalg.norm(local) < STRAIGHT / 5:
        usual = np.cross(ahead, foot - hip)
    usual /= np.maximum(np.linalg.norm(usual, axis=1), 1e-12)[:, None]
    axis = normal + STRAIGHT * usual
    along = foot - hip
    along /= np.maximum(np.linalg.norm(along, axis=1), 1e-12)[:, None]
    axis -= np.einsum("fc,fc->f", axis, along)[:, None] * along
    return np.asarray(axis / np.maximum(np.linalg.norm(axis, axis=1), 1e-12)[:, None])


def bend_limb(
    hip: Points, knee: Points, foot: Points, goal: Points, axis: Points
) -> tuple[Turns, Turns]:
    """Turn the two parts of a limb so that its foot meets the goal, in the plane it bends in.

    First the knee, about the axis, until the foot is as far from the hip as the goal (law of
    cosines); then the whole limb about the hip, by the smallest turn. A goal out of reach is
    approached as far as the limb goes.

    Returns:
        world turns of the upper part (about the hip) and of the lower part.
    """
    upper, lower = knee - hip, foot - knee
    way = goal - hip
    near = np.linalg.norm(way, axis=1) < NEAREST * np.linalg.norm(upper, axis=1)
    way = np.where(near[:, None], NEAREST * (foot - hip), way)  # no direction to turn to
    on_axis = np.einsum("fc,fc->f", upper, axis), np.einsum("fc,fc->f", lower, axis)
    flat = upper - on_axis[0][:, None] * axis, lower - on_axis[1][:, None] * axis
    sizes = np.linalg.norm(flat[0], axis=1) * np.linalg.norm(flat[1], axis=1)
    lengths = np.linalg.norm(upper, axis=1), np.linalg.norm(lower, axis=1)
    bend = np.arctan2(
        np.einsum("fc,fc->f", np.cross(flat[0], flat[1]), axis),
        np.einsum("fc,fc->f", flat[0], flat[1]),
    )
    distance = soft_reach(
        np.linalg.norm(foot - hip, axis=1), np.linalg.norm(way, axis=1), sum(lengths)
    )
    product = (distance**2 - lengths[0] ** 2 - lengths[1] ** 2) / 2 - on_axis[0] * on_axis[1]
    wanted = np.arccos(np.clip(product / np.maximum(sizes, 1e-12), -1.0, 1.0))
    knee_turn = vectors_to_matrices((wanted - bend)[:, None] * axis)
    bent = upper + np.einsum("fab,fb->fa", knee_turn, lower)
    swing = rotation_between(bent, way)
    return swing, swing @ knee_turn


def soft_reach(
    own: Float[np.ndarray, " frames"],
    wanted: Float[np.ndarray, " frames"],
    length: Float[np.ndarray, " frames"],
) -> Float[np.ndarray, " frames"]:
    """Straighten a limb ever more slowly as its last slack is used up, so that no knee snaps.

    Args:
        own: distance from hip to foot so far: one that was nearly straight may stay so.
        wanted: distance to the goal.
        length: of the limb.
    """
    free = np.maximum(own, SLACKENS * length)
    slack = np.maximum(FARTHEST * length - free, 1e-9 * length)
    more = np.maximum(wanted - free, 0.0)
    return np.where(wanted > free, free - slack * np.expm1(-more / slack), wanted)

"""Tell pose from shape: which turns between a source at rest and a figure are the figure's pose.

Registration finds a turn for every joint, but a bull's neck lies 30 degrees lower than a horse's
because of what it is, not of what it does, and a clip must then add to each one's own rest. Arms
in an A against arms in a T, or a figure caught in a run, are poses, and must be undone first.

What decides (docs/log.md has the numbers): the mean turn of the whole surface, held against a bar
that rises with the misfit, because a poor fit turns shape into pose; and, limb by limb for limbs
off the plane of symmetry, how far the turn carries the surface.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.graphs import descendants, root_first
from bunraku.registration.body import Body
from bunraku.registration.puppet import Pose, move_puppet
from bunraku.reposing.energy import local_turns, place_joints, recover_rest_pose
from bunraku.rotations import (
    matrices_to_vectors,
    rotation_angles,
    rotation_between,
    vectors_to_matrices,
    vertical_turn,
)
from bunraku.types import NO_PARENT


@dataclass(frozen=True, eq=False)
class Reposed:
    """A figure's way from the pose it was found in to the source's rest pose."""

    found: Float[np.ndarray, "joints 3"]  # joints as found
    turns: Float[np.ndarray, "joints 3 3"]  # world, from rest to as found, heading left out
    heading: Float[np.ndarray, "3 3"]  # turn about the vertical from the source's front
    places: Float[np.ndarray, "joints 3"]  # joints at rest, facing the source's front
    posed: float  # 0: found at rest; 1: found in another pose


def repose(
    joints: Float[np.ndarray, "joints 3"],
    body: Body,
    surface_turns: Float[np.ndarray, "joints 3 3"],
    trust: Float[np.ndarray, " joints"],
    *,
    misfit: float,
    at_rest: bool = False,
) -> Reposed:
    """Bring a figure's joints into the source's rest pose, about its first joint.

    Args:
        joints: of the figure, as found.
        body: the source.
        surface_turns: world rotation of each joint's surface from rest to as found.
        trust: weight of each surface turn beside the joints' places.
        misfit: of the registration; the larger, the less small turns are believed.
        at_rest: the registration found the figure as the source stands; no turn is believed.
    """
    carriers = body.carriers
    found = recover_rest_pose(
        joints, body.joints, carriers, surface_turns=surface_turns, trust=trust
    )
    turns = np.swapaxes(found, 1, 2)
    heading = nearby_quarter(vertical_turn(turns[body.puppet.joints[0]]))
    turns = heading.T @ turns
    posed, share = believe_turns(body, turns, misfit=misfit)
    own = local_turns(turns, carriers)
    swung = (1.0 - share) * (1.0 - smooth_step(misfit, 0.16, 0.22))
    if at_rest:
        posed, share, swung = 0.0, np.zeros_like(share), np.zeros_like(swung)
    own = scale_turns(limb_swings(body, joints @ heading), swung) @ scale_turns(own, share)
    turns = chain_turns(own, carriers)
    undo = local_turns(np.swapaxes(turns, 1, 2), carriers)
    root = joints[root_first(carriers)[0]]
    ahead = (joints - root) @ heading  # all of it, other roots included, to the source's front
    places, _ = place_joints(ahead, carriers, undo, root)
    return Reposed(joints, turns, heading, places, posed)


def nearby_quarter(heading: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Snap a heading to a quarter turn within 30 degrees of it.

    Figures are modelled along the axes; what is left belongs to the pose.
    """
    yaw = float(np.arctan2(heading[0, 2], heading[0, 0]))
    quarter = np.round(yaw / (np.pi / 2)) * (np.pi / 2)
    if abs(yaw - quarter) > np.deg2rad(30):
        return heading
    return vectors_to_matrices(np.array([0.0, quarter, 0.0]))


def believe_turns(
    body: Body, turns: Float[np.ndarray, "joints 3 3"], *, misfit: float
) -> tuple[float, Float[np.ndarray, " joints"]]:
    """Decide how much of each joint's own turn is pose: all of a posed figure's, or whole limbs'.

    Args:
        turns: world rotation of each joint from rest to as found, heading left out.

    Returns:
        how posed the whole figure is, and the share of each joint's own turn to believe.
    """
    puppet = body.puppet
    mass = puppet.areas @ puppet.weights
    mean = float(mass @ rotation_angles(turns[puppet.joints]) / mass.sum())
    bar = np.deg2rad(11.0 + 14.0 * np.clip((misfit - 0.12) / 0.06, 0.0, 1.0))
    posed = smooth_step(mean, 0.85 * bar, 1.15 * bar)
    moved = displacement(body, turns)
    share = np.full(len(turns), posed)
    below = descendants(body.carriers)
    for limb in limbs(body):
        carried = below[limb, puppet.joints]
        weight = mass * carried
        if weight.sum() > 0.02 * mass.sum():
            reach = float(weight @ moved / weight.sum())
            believed = smooth_step(reach, 0.08, 0.14)
            share[below[limb]] = np.maximum(share[below[limb]], believed)
    return posed, share


def smooth_step(value: float, low: float, high: float) -> float:
    """Rise smoothly from 0 at `low` to 1 at `high`."""
    share = float(np.clip((value - low) / (high - low), 0.0, 1.0))
    return share * share * (3.0 - 2.0 * share)


def displacement(
    body: Body, turns: Float[np.ndarray, "joints 3 3"]
) -> Float[np.ndarray, " puppet_joints"]:
    """Give how far the turns carry each puppet joint's surface from rest, at area 1."""
    puppet = body.puppet
    still = np.zeros((len(puppet.parents), 2))
    own = local_turns(turns[puppet.joints], puppet.parents)
    moved, _ = move_puppet(puppet, Pose(puppet.anchors[0], own, still))
    distance = np.linalg.norm(moved - puppet.vertices, axis=1)
    weight = puppet.areas[:, None] * puppet.weights
    return (distance @ weight) / np.maximum(weight.sum(axis=0), 1e-30)


def limbs(body: Body) -> Int[np.ndarray, " limbs"]:
    """Name the joint at which each limb leaves the plane of symmetry."""
    off = off_symmetry(body.joints, body.proxy.mesh.vertices)
    above = np.where(body.carriers == NO_PARENT, 0, body.carriers)
    return np.flatnonzero(off & (~off[above] | (body.carriers == NO_PARENT)))


def off_symmetry(
    joints: Float[np.ndarray, "joints 3"], vertices: Float[np.ndarray, "vertices 3"]
) -> Bool[np.ndarray, " joints"]:
    """Tell which joints lie off the source's plane of symmetry, of the two vertical candidates.

    The plane is the one whose mirror image of the joints fits best for how far they spread.
    """
    middle = np.median(joints, axis=0)  # of the surface it would follow a sword in one hand
    extent = float(np.ptp(vertices, axis=0).max())
    doubts = []
    for axis in (0, 2):
        mirrored = joints.copy()
        mirrored[:, axis] = 2 * middle[axis] - joints[:, axis]
        error = np.linalg.norm(mirrored[:, None] - joints, axis=2).min(axis=1).mean()
        doubts.append(error - 0.5 * joints[:, axis].std())
    axis = (0, 2)[int(np.argmin(doubts))]
    return np.asarray(np.abs(joints[:, axis] - middle[axis]) > 0.02 * extent)


def limb_swings(
    body: Body, joints: Float[np.ndarray, "joints 3"]
) -> Float[np.ndarray, "joints 3 3"]:
    """Swing each limb, at its first joint and whole, from its direction at rest to the figure's.

    A stance is more than its large turns: legs that stand closer together must start closer. Only
    a good fit tells it from noise (docs/log.md).

    Args:
        joints: of the figure as found, its heading undone.

    Returns:
        a turn for the first joint of each limb, none for all others.
    """
    swings = np.tile(np.eye(3), (len(joints), 1, 1))
    mass = body.areas @ body.weights / body.areas.sum()
    below = descendants(body.carriers) & (mass > 4e-3)
    for limb in limbs(body):
        reach = np.linalg.norm(body.joints - body.joints[limb], axis=1) * below[limb]
        end = int(reach.argmax())
        rest, found = body.joints[end] - body.joints[limb], joints[end] - joints[limb]
        if mass[below[limb]].sum() > 0.02 and reach[end] > 0 and found.any():
            swings[limb] = rotation_between(rest, found)
    return swings


def scale_turns(
    turns: Float[np.ndarray, "joints 3 3"], share: Float[np.ndarray, " joints"]
) -> Float[np.ndarray, "joints 3 3"]:
    """Take a share of each turn, about its own axis."""
    return vectors_to_matrices(matrices_to_vectors(turns) * share[:, None])


def chain_turns(
    own: Float[np.ndarray, "joints 3 3"], parents: Int[np.ndarray, " joints"]
) -> Float[np.ndarray, "joints 3 3"]:
    """Chain each joint's own turn down the tree into world rotations."""
    return place_joints(np.zeros((len(parents), 3)), parents, own, np.zeros(3))[1]

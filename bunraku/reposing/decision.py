"""Tell pose from shape: which turns between a source at rest and a figure are the figure's pose.

Registration finds a turn for every joint, but a bull's neck lies 30 degrees lower than a horse's
because of what it is, not of what it does, and a clip must then add to each one's own rest. Arms
in an A against arms in a T, or a figure caught in a run, are poses, and must be undone first.

What decides (docs/log.md has the numbers): where each limb points as a whole, which hardly differs
between bodies at rest and differs much in motion; and the mean turn of the whole surface, held
against a bar that rises with the misfit, because a poor fit turns shape into pose. Where limbs
alone tell of a pose, turns of trunk, neck and tail are believed only of bodies that are alike.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.graphs import ancestors, descendants, root_first
from bunraku.registration.body import Body
from bunraku.reposing.energy import goal_joints, local_turns, place_joints, recover_rest_pose
from bunraku.reposing.slides import undo_slides
from bunraku.reposing.symmetry import straighten, symmetry_axis
from bunraku.rotations import (
    matrices_to_vectors,
    rotation_angles,
    rotation_between,
    vectors_to_matrices,
    vertical_turn,
)
from bunraku.types import NO_PARENT

MOST_TURN = np.deg2rad(90.0)  # farther a joint turns only in a fit gone wrong


@dataclass(frozen=True, eq=False)
class Reposed:
    """A figure's way from the pose it was found in to the source's rest pose."""

    found: Float[np.ndarray, "joints 3"]  # joints as found
    turns: Float[np.ndarray, "joints 3 3"]  # world, from rest to as found, heading left out
    heading: Float[np.ndarray, "3 3"]  # turn about the vertical from the source's front
    places: Float[np.ndarray, "joints 3"]  # joints at rest, facing the source's front
    posed: float  # 0: found at rest; 1: found in another pose
    trunk: float = 0.0  # share of the trunk's turn that was taken for pose


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
    joints, surface_turns, trust = hang_on_hips(joints, body, surface_turns, trust)
    found = recover_rest_pose(
        joints, body.joints, carriers, surface_turns=surface_turns, trust=trust
    )
    turns = np.swapaxes(found, 1, 2)
    heading = nearby_quarter(vertical_turn(turns[body.puppet.joints[0]]))
    turns = heading.T @ turns
    posed, share = believe_turns(body, turns, joints @ heading, misfit=misfit)
    if at_rest:
        posed, share = 0.0, np.zeros_like(share)
    turns = scale_turns(turns, share)
    undo = local_turns(np.swapaxes(turns, 1, 2), carriers)
    root = joints[root_first(carriers)[0]]
    ahead = (joints - root) @ heading  # all of it, other roots included, to the source's front
    places, _ = place_joints(ahead, carriers, undo, root)
    sure = 0.0 if at_rest else posed * sure_of_limbs(misfit)
    places = undo_slides(straighten(places, body, sure), body, turns, sure)
    trunk = float(share[body.puppet.joints[0]])
    return Reposed(joints, turns, heading, places, posed, trunk)


def hang_on_hips(
    joints: Float[np.ndarray, "joints 3"],
    body: Body,
    turns: Float[np.ndarray, "joints 3 3"],
    trust: Float[np.ndarray, " joints"],
) -> tuple[
    Float[np.ndarray, "joints 3"], Float[np.ndarray, "joints 3 3"], Float[np.ndarray, " joints"]
]:
    """Let the joints above the hips follow them, as if they were one: places, turns and trust.

    What little surface a floor root moves says nothing of where it is, or how it turned.
    """
    hips = int(body.puppet.joints[0])
    floor = np.array(ancestors(body.carriers, hips)[1:], np.int64)
    kept = body.puppet.joints
    spread = [np.linalg.norm(points[kept] - points[hips]) for points in (joints, body.joints)]
    scale = spread[0] / spread[1] if spread[1] > 0 else 1.0
    joints, turns, trust = joints.copy(), turns.copy(), trust.copy()
    joints[floor] = joints[hips] + scale * (body.joints[floor] - body.joints[hips]) @ turns[hips].T
    turns[floor], trust[floor] = turns[hips], trust[hips]
    return joints, turns, trust


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
    body: Body,
    turns: Float[np.ndarray, "joints 3 3"],
    joints: Float[np.ndarray, "joints 3"],
    *,
    misfit: float,
) -> tuple[float, Float[np.ndarray, " joints"]]:
    """Decide how much of each joint's turn is pose: all of a posed figure's, or whole limbs'.

    A figure is posed if its surface turned as a whole, or if the limbs it stands on swung: arms in
    a T, where the source's hang, do not make a pose. All limbs of a posed figure are believed, but
    of a poor fit only those that swung far; the trunk's turn, as legs tell it, only of a good fit.

    Args:
        turns: world rotation of each joint from rest to as found, heading left out.
        joints: of the figure as found, heading left out.
        misfit: of the registration.

    Returns:
        how posed the whole figure is, and the share of each joint's turn to believe.
    """
    puppet = body.puppet
    mass = puppet.areas @ puppet.weights
    angles = rotation_angles(turns[puppet.joints]).clip(max=MOST_TURN)
    mean = float(mass @ angles / mass.sum())
    bar = np.deg2rad(11.0 + 24.0 * np.clip((misfit - 0.12) / 0.03, 0.0, 1.0))
    turned = smooth_step(mean, 0.85 * bar, 1.15 * bar)
    swings = limb_swings(body, turns, joints)
    legs = [swing for limb, swing in swings.items() if is_stood_on(body, limb)]
    mean_swing = float(np.mean(legs or [*swings.values()] or [0.0]))
    swung = smooth_step(mean_swing, np.deg2rad(14.0), np.deg2rad(20.0))
    posed = max(turned, swung)
    trunk = max(turned, swung * (1.0 - smooth_step(misfit, 0.155, 0.175)))
    every = posed * sure_of_limbs(misfit)
    share = np.full(len(turns), trunk)
    below = descendants(body.carriers)
    for limb, swing in swings.items():
        alone = smooth_step(swing, np.deg2rad(17.0), np.deg2rad(27.0))
        share[below[limb]] = np.maximum(share[below[limb]], max(every, alone))
    return posed, share


def sure_of_limbs(misfit: float) -> float:
    """Say how far to believe every limb of a posed figure, by the fit."""
    return 1.0 - smooth_step(misfit, 0.28, 0.34)


def smooth_step(value: float, low: float, high: float) -> float:
    """Rise smoothly from 0 at `low` to 1 at `high`."""
    share = float(np.clip((value - low) / (high - low), 0.0, 1.0))
    return share * share * (3.0 - 2.0 * share)


def limbs(body: Body) -> Int[np.ndarray, " limbs"]:
    """Name the joint at which each limb leaves the plane of symmetry."""
    off = off_symmetry(body.joints, body.proxy.mesh.vertices)
    above = np.where(body.carriers == NO_PARENT, 0, body.carriers)
    return np.flatnonzero(off & (~off[above] | (body.carriers == NO_PARENT)))


def off_symmetry(
    joints: Float[np.ndarray, "joints 3"], vertices: Float[np.ndarray, "vertices 3"]
) -> Bool[np.ndarray, " joints"]:
    """Tell which joints lie off the source's plane of symmetry."""
    axis = symmetry_axis(joints, vertices)
    away = joints[:, axis] - np.median(joints[:, axis])
    return np.asarray(np.abs(away) > 0.02 * float(np.ptp(vertices, axis=0).max()))


def limb_swings(
    body: Body,
    turns: Float[np.ndarray, "joints 3 3"],
    joints: Float[np.ndarray, "joints 3"],
) -> dict[int, float]:
    """Measure how far each limb, as a whole, points away from where it points at rest.

    From its first joint to its last one, the bones as long as the source's: a long foot on a short
    leg is no swing. Limbs of less than a twenty-fifth of the surface (ears, antlers) do not count.

    Args:
        turns: world rotation of each joint from rest to as found, heading left out.
        joints: of the figure as found, heading left out.

    Returns:
        angle by the limb's first joint, in radians.
    """
    mass = body.areas @ body.weights / body.areas.sum()
    below = descendants(body.carriers)
    goal = goal_joints(body.joints, joints, body.carriers)
    swings = {}
    for limb in limbs(body).tolist():
        if mass[below[limb]].sum() < 0.04:
            continue
        reach = np.linalg.norm(body.joints - body.joints[limb], axis=1)
        reach *= below[limb] & (mass > 4e-3)
        end = int(reach.argmax()) if reach.any() else limb
        rest, found = body.joints[end] - body.joints[limb], goal[end] - goal[limb]
        if end == limb:  # a limb of one bone ends where its surface does
            own = body.areas * body.weights[:, below[limb]].sum(axis=1)
            rest = own @ body.proxy.mesh.vertices / own.sum() - body.joints[limb]
            found = turns[limb] @ rest
        if rest.any() and found.any():
            swings[limb] = float(rotation_angles(rotation_between(rest, found)[None])[0])
    return swings


def is_stood_on(body: Body, limb: int, *, near: float = 0.06) -> bool:
    """Tell whether a limb of the source at rest reaches the ground.

    Args:
        limb: its first joint.
        near: how close, in heights of the source.
    """
    height = body.proxy.mesh.vertices[:, 1]
    own = body.weights[:, descendants(body.carriers)[limb]].sum(axis=1) > 0.5
    return bool(own.any() and height[own].min() - height.min() < near * np.ptp(height))


def scale_turns(
    turns: Float[np.ndarray, "joints 3 3"], share: Float[np.ndarray, " joints"]
) -> Float[np.ndarray, "joints 3 3"]:
    """Take a share of each turn, about its own axis.

    In the world: a believed arm points where it was found, however little of the trunk's turn is
    believed, and half a turn of a straight leg leaves it straight.
    """
    return vectors_to_matrices(matrices_to_vectors(turns) * share[:, None])

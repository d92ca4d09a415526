"""Find the legs of a rig: chains of joints that end near the ground, in like pairs, of any species.

Names are not asked. A foot is the topmost of the joints whose surface reaches the ground at rest;
its leg is the chain above it that no other foot hangs on; and a leg has a partner like it (a tail
that drags along the ground has none).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.graphs import ancestors, descendants
from bunraku.types import NO_PARENT

TOUCHING = 0.03  # of the height: how near the ground the surface of a foot comes
LOW = 0.2  # of the height: how high the joint of a foot may lie (a robe reaches down from knees)
OWN = 0.4  # weight from which surface counts as a joint's own
LEAST_BONE = 0.02  # of the height: a shorter part of a leg cannot be bent
NEAR = 0.15  # of the height: how far from a foot's joints a stray one may lie
ALIKE = 0.25  # of its length: by how much a leg's bones and heights may differ from its partner's


@dataclass(frozen=True, eq=False)
class Leg:
    """A chain from hip to foot that bends at one knee, and what hangs on each of its parts."""

    hip: int
    knee: int  # the joint that halves the chain best
    foot: int  # topmost joint near the ground: the ankle, a horse's fetlock
    upper: Int[np.ndarray, " upper"]  # joints that turn with the part above the knee, hip included
    lower: Int[np.ndarray, " lower"]  # with the part below it, knee included
    end: Int[np.ndarray, " end"]  # with the foot, which is included
    soles: Int[np.ndarray, " soles"]  # those of the end whose surface touches the ground


def find_legs(
    vertices: Float[np.ndarray, "vertices 3"],
    weights: Float[np.ndarray, "vertices joints"],
    joints: Float[np.ndarray, "joints 3"],
    carriers: Int[np.ndarray, " joints"],
) -> tuple[Leg, ...]:
    """Find the legs that can be bent; none in a snake, a fish, or a body on single bones.

    Args:
        vertices: the body at rest, in metres, Y up; its lowest point is the ground.
        weights: its skin.
        joints: at rest.
        carriers: the tree of who carries whom, which may differ from the rig's own (IK feet).
    """
    ground, height = float(vertices[:, 1].min()), float(np.ptp(vertices[:, 1]))
    lowest = np.where(weights > OWN, vertices[:, 1:2], np.inf).min(axis=0)
    low = (lowest - ground < TOUCHING * height) & (joints[:, 1] - ground < LOW * height)
    below = descendants(carriers)
    feet = [j for j in np.flatnonzero(low) if not low[ancestors(carriers, int(j))[1:]].any()]
    chains = [_leg_above(int(foot), carriers, below[:, feet].sum(axis=1)) for foot in feet]
    pairs = [_trim_to_partner(chain, chains, joints) for chain in chains]
    found = [_split_leg(chain, joints, below, low) for chain in pairs if len(chain) > 2]
    legs = [leg for leg in found if _can_bend(leg, joints, LEAST_BONE * height)]
    return tuple(_take_strays(legs, low, joints, NEAR * height))


def _leg_above(
    foot: int, carriers: Int[np.ndarray, " joints"], feet_below: Int[np.ndarray, " joints"]
) -> list[int]:
    """List the joints from a foot up to its hip: the last one on which no other foot hangs."""
    chain = [foot]
    while carriers[chain[-1]] != NO_PARENT and feet_below[carriers[chain[-1]]] == 1:
        chain.append(int(carriers[chain[-1]]))
    return chain


def _trim_to_partner(
    chain: list[int], chains: list[list[int]], joints: Float[np.ndarray, "joints 3"]
) -> list[int]:
    """Cut a chain to what it has in common with the one most like it; to nothing if none is.

    Two legs are alike if they are equally long and equally high, joint by joint. A tail that
    reaches the ground is like none.
    """
    best, common = 1.0, 0
    for other in chains:
        count = min(len(chain), len(other))
        if other is chain or count < 3:
            continue
        ours, theirs = joints[chain[:count]], joints[other[:count]]
        lengths = [np.linalg.norm(np.diff(points, axis=0), axis=1) for points in (ours, theirs)]
        unlike = np.abs(lengths[0] - lengths[1]).sum() + np.abs(ours - theirs)[:, 1].max()
        measure = float(unlike / (ALIKE * lengths[0].sum()))
        if measure < best:
            best, common = measure, count
    return chain[:common]


def _split_leg(
    chain: list[int],
    joints: Float[np.ndarray, "joints 3"],
    below: Bool[np.ndarray, "joints joints"],
    low: Bool[np.ndarray, " joints"],
) -> Leg:
    """Make a leg of a chain, bent where the shorter of its two parts is longest."""
    foot, hip = chain[0], chain[-1]
    away = np.linalg.norm(joints[chain[1:-1], None] - joints[[foot, hip]], axis=2).min(axis=1)
    knee = chain[1 + int(away.argmax())]
    return Leg(
        *(hip, knee, foot),
        np.flatnonzero(below[hip] & ~below[knee]),
        np.flatnonzero(below[knee] & ~below[foot]),
        np.flatnonzero(below[foot]),
        np.flatnonzero(below[foot] & low),
    )


def _can_bend(leg: Leg, joints: Float[np.ndarray, "joints 3"], least: float) -> bool:
    """Tell whether both parts of a leg have a length, and it reaches down."""
    parts = np.linalg.norm(joints[[leg.hip, leg.foot]] - joints[leg.knee], axis=1)
    return bool(parts.min() > least and joints[leg.hip, 1] > joints[leg.foot, 1])


def _take_strays(
    legs: list[Leg],
    low: Bool[np.ndarray, " joints"],
    joints: Float[np.ndarray, "joints 3"],
    near: float,
) -> list[Leg]:
    """Let joints on the ground that hang on no leg, as some rigs' feet do, go with the nearest."""
    taken = {int(joint) for leg in legs for joint in leg.end}
    strays: dict[int, list[int]] = {}
    for joint in sorted(set(np.flatnonzero(low).tolist()) - taken):
        away = [
            float(np.linalg.norm(joints[leg.soles] - joints[joint], axis=1).min()) for leg in legs
        ]
        if away and min(away) < near:
            strays.setdefault(int(np.argmin(away)), []).append(joint)
    return [
        replace(leg, end=np.append(leg.end, np.array(strays.get(i, []), np.int64)))
        for i, leg in enumerate(legs)
    ]

"""Starts for figures of other proportions: the tips of limbs held to the figure's tips.

Where limbs end is told by the shape alone, whatever its proportions; closest points are not (the
torso of a realistic body falls into the head of a stylised one). Tips are paired by where they lie
in the bounding box; bones then stretch until the tips meet, before any surface is compared.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from bunraku.graphs import geodesic_distances
from bunraku.meshes import referenced
from bunraku.registration.articulated import Stage, fit, gauss_newton_step
from bunraku.registration.correspondence import Pairs, Surface, join_pairs, pin
from bunraku.registration.puppet import Pose, Puppet, rest_pose
from bunraku.rotations import vectors_to_matrices

REACH = Stage(12, 0, 0.0, 1.0, 1.0, 1e-2, 1e-3)  # to the tips alone
SETTLE = (
    Stage(8, 250, 0.1, 0.3, 1.0, 1e-2, 1e-3),
    Stage(8, 250, 0.1, 0.2, 0.5, 3e-3, 1e-3),
)
QUARTERS = vectors_to_matrices(np.array([[0.0, k * np.pi / 2, 0.0] for k in range(4)]))


def limb_tips(puppet: Puppet) -> Int[np.ndarray, " tips"]:
    """Find the vertex at the end of each joint without children: of its own, the farthest."""
    leaves = np.flatnonzero(~puppet.children.any(axis=1))
    distance = np.linalg.norm(puppet.vertices[:, None] - puppet.anchors[leaves], axis=2)
    reach = distance * puppet.weights[:, leaves]
    reach[~referenced(puppet.faces, len(reach))] = -1.0  # landmarks are no surface
    return np.unique(np.argmax(reach, axis=0))


def surface_tips(puppet: Puppet, surface: Surface) -> Int[np.ndarray, " tips"]:
    """Find the extremities of a figure, twice as many as the puppet has limbs and a few more."""
    return remote_points(surface.vertices, surface.faces, 2 * len(limb_tips(puppet)) + 4)


def remote_points(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], count: int
) -> Int[np.ndarray, " tips"]:
    """Find the extremities of a surface: farthest points along it, the most remote first."""
    used = np.unique(faces)
    offset = vertices[used] - vertices[used].mean(axis=0)
    middle = int(used[np.linalg.norm(offset, axis=1).argmin()])
    chosen = [middle]
    distance = geodesic_distances(vertices, faces, np.array([middle]))[0]
    for _ in range(count):
        chosen.append(int(np.where(np.isfinite(distance), distance, -1.0).argmax()))
        latest = geodesic_distances(vertices, faces, np.array(chosen[-1:]))[0]
        distance = np.minimum(distance, latest)
    return np.array(chosen[1:])


def in_box(
    points: Float[np.ndarray, "points 3"], around: Float[np.ndarray, "vertices 3"]
) -> Float[np.ndarray, "points 3"]:
    """Give points as shares, -1 to 1, of the height and the greater width of others."""
    low, high = around.min(axis=0), around.max(axis=0)
    width = max(float(high[0] - low[0]), float(high[2] - low[2]), 1e-9)
    size = np.array([width, max(float(high[1] - low[1]), 1e-9), width])
    return (2 * points - low - high) / size


def twin_tips(
    points: Float[np.ndarray, "tips 3"], around: Float[np.ndarray, "vertices 3"]
) -> list[tuple[int, int]]:
    """Find the tips that mirror each other: both hands, both feet, both ears."""
    if not len(points):
        return []
    boxed = in_box(points, around)
    gap = np.linalg.norm((boxed * [-1.0, 1.0, 1.0])[:, None] - boxed, axis=2)
    nearest = gap.argmin(axis=1)
    return [
        (tip, int(twin))
        for tip, twin in enumerate(nearest)
        if tip < twin and nearest[twin] == tip and gap[tip, twin] < 0.2
    ]


def between(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"], ends: np.ndarray
) -> Int[np.ndarray, " pairs"]:
    """Find the middle of the way along the surface between the two vertices of each pair.

    Between the feet lies the crotch, between the hands the chest: where limbs begin, in figures
    of any proportions.
    """
    ways = geodesic_distances(vertices, faces, ends.ravel()).reshape(*ends.shape, -1)
    return ways.max(axis=1).argmin(axis=1)


def pair_landmarks(
    puppet: Puppet,
    surface: Surface,
    others: Int[np.ndarray, " tips"],
    heading: Float[np.ndarray, "3 3"],
    *,
    farthest: float = 0.7,
) -> tuple[Pairs, float]:
    """Pair tips, turned to a heading, by their place in the box; then where twin limbs meet.

    Args:
        others: extremities of the surface.
        farthest: tips farther apart than this (of half the box) stay unpaired.

    Returns:
        the pairs, and how far apart in the box the tips lie, on average and at most `farthest`.
    """
    tips = limb_tips(puppet)
    turned = puppet.vertices @ heading.T
    own, theirs = in_box(turned[tips], turned), in_box(surface.vertices[others], surface.vertices)
    cost = np.linalg.norm(own[:, None] - theirs, axis=2)
    row, column = linear_sum_assignment(cost)
    near = cost[row, column] < farthest
    moving, still = tips[row[near]], others[column[near]]
    twins = np.array(twin_tips(puppet.vertices[moving], puppet.vertices), np.int64).reshape(-1, 2)
    if len(twins):
        middles = between(puppet.vertices, puppet.faces, moving[twins])
        goals = between(surface.vertices, surface.faces, still[twins])
        moving, still = np.concatenate([moving, middles]), np.concatenate([still, goals])
    return pin(moving, still, 1.0), float(np.minimum(cost[row, column], farthest).mean())


def reach_tips(
    puppet: Puppet, surface: Surface, pins: Pairs, heading: Float[np.ndarray, "3 3"]
) -> Pose:
    """Stretch and turn the puppet, faced to a heading, until its tips meet the figure's."""
    pose = rest_pose(puppet, heading)
    if len(pins.moving) < 3:
        return pose
    known = join_pairs(pins, surface.pins)
    for _ in range(REACH.steps):
        pose = gauss_newton_step(puppet, pose, surface, known, REACH)
    held = pin(pins.moving, pins.still, 100.0 / len(pins.moving))
    pinned = replace(surface, pins=join_pairs(surface.pins, held))
    return fit(puppet, pose, pinned, SETTLE, home=pose)

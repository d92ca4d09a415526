"""Fit a puppet to a surface by Gauss-Newton over its joints' turns and bone scales.

Each step pairs the surfaces both ways and solves one small dense system: point-to-plane with a
share of point-to-point, turns kept small, scales kept near their parent's.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve

from bunraku.registration.correspondence import (
    Pairs,
    Surface,
    find_pairs,
    join_pairs,
    misfit,
    robust_weights,
)
from bunraku.registration.puppet import Pose, Puppet, move_puppet, rest_pose, step_pose
from bunraku.rotations import matrices_to_vectors
from bunraku.types import NO_PARENT

JUMP = 0.3  # difference of log-scales from which on a bone is simply another than its parent
LARGEST_STEP = 0.6  # radians, log-scale or lengths: one step changes nothing by more
CROSS = np.zeros((3, 3, 3))  # cross(w, b)_a = CROSS[a, r, c] w_r b_c
CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
CROSS[[0, 1, 2], [2, 0, 1], [1, 2, 0]] = -1.0


@dataclass(frozen=True)
class Stage:
    """One stage of a fit, from stiff and far-sighted to loose and near-sighted."""

    steps: int
    queries: int  # samples of each side that ask for their nearest
    normals: float  # weight of normals in the search, in units of sqrt(area)
    width: float  # of the robust weight, in units of sqrt(area)
    points: float  # share of point-to-point beside point-to-plane
    turns: float  # cost of a joint's turn away from rest
    scales: float  # cost of a bone's scale away from its parent's
    samples: int = 1500


COARSE = (
    Stage(6, 250, 0.1, 0.5, 1.0, 1e-3, 1e-1),
    Stage(6, 250, 0.1, 0.3, 1.0, 3e-4, 3e-2),
    Stage(8, 250, 0.1, 0.2, 0.5, 1e-4, 1e-2),
)
FINE = (
    Stage(6, 500, 0.1, 0.15, 0.3, 3e-5, 3e-3),
    Stage(8, 500, 0.08, 0.1, 0.2, 1e-5, 1e-3),
    Stage(8, 500, 0.05, 0.06, 0.1, 1e-5, 3e-4),
)
# the same for proportions unlike the source's: bones stretch before they turn
STIFF = (
    Stage(8, 500, 0.1, 0.15, 0.3, 3e-3, 3e-4),
    Stage(8, 500, 0.08, 0.1, 0.2, 1e-3, 1e-4),
    Stage(8, 500, 0.05, 0.06, 0.1, 1e-3, 1e-4),
)
# the same for a figure that stands as the source does: hardly a turn
FIRM = (
    Stage(8, 500, 0.1, 0.3, 1.0, 1e-1, 1e-2),
    Stage(8, 500, 0.1, 0.15, 0.3, 1e-1, 1e-2),
    Stage(8, 500, 0.08, 0.1, 0.2, 3e-2, 1e-2),
)


def fit(
    puppet: Puppet,
    pose: Pose,
    surface: Surface,
    schedule: tuple[Stage, ...],
    *,
    home: Pose | None = None,
) -> Pose:
    """Run a schedule of Gauss-Newton steps from a start pose.

    Args:
        home: the pose whose turns and scales cost nothing; None for the source at rest.
    """
    for stage in schedule:
        for _ in range(stage.steps):
            samples = puppet.samples[: stage.samples]
            pairs = find_pairs(
                move_puppet(puppet, pose, samples),
                samples,
                surface,
                normal_weight=stage.normals,
                queries=stage.queries,
            )
            pairs = join_pairs(pairs, surface.pins)
            pose = gauss_newton_step(puppet, pose, surface, pairs, stage, home=home)
    return pose


def fit_error(puppet: Puppet, pose: Pose, surface: Surface) -> float:
    """Give the misfit of a posed puppet (0 perfect, 2 nowhere near)."""
    samples = puppet.samples[:1500]
    return misfit(move_puppet(puppet, pose, samples), samples, surface)


def gauss_newton_step(
    puppet: Puppet,
    pose: Pose,
    surface: Surface,
    pairs: Pairs,
    stage: Stage,
    *,
    home: Pose | None = None,
) -> Pose:
    """Solve one linearised fit and apply it, no unknown by more than LARGEST_STEP."""
    jacobian, moved = motion_jacobian(puppet, pose, pairs.moving)
    residual = surface.vertices[pairs.still] - moved
    normal = surface.normals[pairs.still]
    weight = pairs.weight * robust_weights(pairs.squared, stage.width)
    weight /= weight.sum()
    on_plane = np.einsum("pa,pau->pu", normal, jacobian)
    hessian = on_plane.T @ (weight[:, None] * on_plane)
    gradient = on_plane.T @ (weight * np.einsum("pa,pa->p", normal, residual))
    flat = jacobian.reshape(len(residual) * 3, -1)
    each = np.repeat(stage.points * weight, 3)
    hessian += flat.T @ (each[:, None] * flat)
    gradient += flat.T @ (each * residual.ravel())
    add_priors(hessian, gradient, puppet, pose, stage, home or rest_pose(puppet))
    return apply_step(puppet, pose, cho_solve(cho_factor(hessian), gradient))


def apply_step(puppet: Puppet, pose: Pose, step: Float[np.ndarray, " unknowns"]) -> Pose:
    """Apply a step of [turns, log-scales along, across, root], shortened to LARGEST_STEP."""
    step = step * min(1.0, LARGEST_STEP / max(float(np.abs(step).max()), 1e-12))
    count = len(puppet.parents)
    turns, scales, shift = np.split(step, [3 * count, 5 * count])
    return step_pose(puppet, pose, turns.reshape(-1, 3), scales.reshape(2, -1).T, shift)


def motion_jacobian(
    puppet: Puppet, pose: Pose, chosen: np.ndarray
) -> tuple[Float[np.ndarray, "chosen 3 unknowns"], Float[np.ndarray, "chosen 3"]]:
    """Differentiate chosen vertices by turns, scales along and across, and the root's place."""
    turns, linear, anchors = pose.world(puppet)
    weights, count = puppet.weights[chosen], len(puppet.parents)
    offsets = anchors - np.einsum("jab,jb->ja", linear, puppet.anchors)
    carried = np.einsum("jab,vb->vja", linear, puppet.vertices[chosen]) + offsets
    weighted = weights[:, :, None] * carried
    share = weights @ puppet.below.T  # of each joint's whole subtree
    lever = np.einsum("jk,vka->vja", puppet.below, weighted, optimize=True)
    lever -= share[:, :, None] * anchors
    jacobian = np.empty((len(weights), 3, 5 * count + 3))
    by_turn = np.einsum("arc,vjc->vajr", CROSS, lever, optimize=True)
    jacobian[:, :, : 3 * count] = by_turn.reshape(len(weights), 3, -1)
    # a scale moves its own surface away from the anchor, and the subtrees with their anchors
    reach = weighted - weights[:, :, None] * anchors
    reach += np.einsum("jk,vk,ka->vja", puppet.children, share, anchors, optimize=True)
    reach -= (share @ puppet.children.T)[:, :, None] * anchors
    direction = np.einsum("jab,jb->ja", turns, puppet.axes)
    along = np.einsum("vja,ja->vj", reach, direction)[:, :, None] * direction
    jacobian[:, :, 3 * count : 4 * count] = along.transpose(0, 2, 1)
    jacobian[:, :, 4 * count : 5 * count] = (reach - along).transpose(0, 2, 1)
    jacobian[:, :, 5 * count :] = np.eye(3)
    return jacobian, weighted.sum(axis=1)


def scale_costs(
    parents: Int[np.ndarray, " joints"], scales: Float[np.ndarray, "2 joints"]
) -> Float[np.ndarray, "unknowns unknowns"]:
    """Give the cost of log-scales, along and across: unlike the parent's, other than 1, or apart.

    Unlike the parent's by much costs hardly more than by JUMP: a cartoon's head is large, and its
    neck is not.
    """
    count = len(parents)
    child = np.flatnonzero(parents != NO_PARENT)
    difference = np.eye(count)
    difference[child, parents[child]] = -1.0
    difference[parents == NO_PARENT] *= 0.3
    held = 1.0 / (1.0 + (scales @ difference.T / JUMP) ** 2)
    along, across = (difference.T @ (each[:, None] * difference) for each in held)
    own, tie = 0.2 * np.eye(count), 0.3 * np.eye(count)
    return np.block([[along + own + tie, -tie], [-tie, across + own + tie]])


def add_priors(
    hessian: Float[np.ndarray, "unknowns unknowns"],
    gradient: Float[np.ndarray, " unknowns"],
    puppet: Puppet,
    pose: Pose,
    stage: Stage,
    home: Pose,
) -> None:
    """Add, in place, the costs of turning away from home and of scaling unlike the parent.

    A turn costs what the source's clips say of that joint and axis; the root turns freely.
    """
    count = len(puppet.parents)
    turns, _, _ = pose.world(puppet)
    above = np.concatenate([np.eye(3)[None], turns])[puppet.parents + 1]
    turned = pose.rotations @ np.swapaxes(home.rotations, 1, 2)
    vectors = np.einsum("jab,jb->ja", above, matrices_to_vectors(turned))
    cost = stage.turns * (above @ puppet.stiffness @ np.swapaxes(above, 1, 2))
    cost[puppet.parents == NO_PARENT] = 0.0
    gradient[: 3 * count] -= np.einsum("jab,jb->ja", cost, vectors).ravel()
    both = slice(3 * count, 5 * count)
    stretched = (pose.scales - home.scales).T
    block = stage.scales * scale_costs(puppet.parents, stretched)
    hessian[both, both] += block
    gradient[both] -= block @ stretched.ravel()
    diagonal = np.arange(len(hessian))
    hessian[diagonal, diagonal] += 1e-7
    turning, each = np.zeros((count, 3, count, 3)), np.arange(count)
    turning[each, :, each] = cost
    hessian[: 3 * count, : 3 * count] += turning.reshape(3 * count, 3 * count)

"""Carry joints from one surface to another through a map between them.

Two ways, both local: the affine regressor (joints as fixed combinations of the vertices around
them) and the similarity that moves a joint's neighbourhood best. After Marin, Musoni, Melzi,
Castellani 2021, "Methodology for skeleton transfer"; closed form in place of gradient descent.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.graphs import depths, descendants
from bunraku.rotations import nearest_rotation
from bunraku.types import NO_PARENT

LEAST_SUPPORT = 12  # vertices that must surround a joint before an affine regressor is trusted
FARTHEST_APART = 0.1  # of the figure's diagonal: beyond it the regressor ran away from its ring


def joint_support(
    weights: Float[np.ndarray, "vertices joints"],
    parents: Int[np.ndarray, " joints"],
    *,
    least: float = 0.1,
) -> Bool[np.ndarray, "vertices joints"]:
    """Mark the vertices around each joint: those that it and its parent both move.

    Args:
        least: weight that both must exceed; a root needs .5 of its own.
    """
    with_parent = weights[:, np.where(parents == NO_PARENT, 0, parents)]
    both = (weights > least) & (with_parent > least)
    return np.asarray(np.where(parents == NO_PARENT, weights > 0.5, both))


def regress_joints(
    vertices: Float[np.ndarray, "vertices 3"],
    areas: Float[np.ndarray, " vertices"],
    support: Bool[np.ndarray, "vertices joints"],
    joints: Float[np.ndarray, "joints 3"],
    images: Float[np.ndarray, "vertices 3"],
) -> tuple[Float[np.ndarray, "joints 3"], Bool[np.ndarray, " joints"]]:
    """Place joints by minimum-norm affine weights: min sum r^2/m s.t. [X; 1]^T r = [J; 1].

    Args:
        vertices: source surface at rest.
        areas: of its vertices, m.
        support: vertices around each joint, from `joint_support`.
        joints: source joints at rest.
        images: where the map puts the source's vertices on the target.

    Returns:
        joints on the target, and which of them had enough support (the others are NaN).
    """
    placed = np.full(joints.shape, np.nan)
    known = support.sum(axis=0) >= LEAST_SUPPORT
    for joint in np.flatnonzero(known):
        around = np.flatnonzero(support[:, joint])
        mass = areas[around] / areas[around].sum()
        centre = mass @ vertices[around]
        rows = np.vstack([(vertices[around] - centre).T, np.ones(len(around))])
        wanted = np.append(joints[joint] - centre, 1.0)
        multiplier = np.linalg.lstsq((rows * mass) @ rows.T, wanted, rcond=1e-6)[0]
        placed[joint] = (mass * (multiplier @ rows)) @ images[around]
    return placed, known


def region_weights(
    areas: Float[np.ndarray, " vertices"],
    weights: Float[np.ndarray, "vertices joints"],
    parents: Int[np.ndarray, " joints"],
) -> Float[np.ndarray, "vertices joints"]:
    """Weigh the vertices around each joint: area x W_j x (W_parent + a little W_j)."""
    above = np.where(parents == NO_PARENT, np.arange(len(parents)), parents)
    return areas[:, None] * weights * (weights[:, above] + 0.02 * weights)


def fit_similarities(
    vertices: Float[np.ndarray, "vertices 3"],
    images: Float[np.ndarray, "vertices 3"],
    regions: Float[np.ndarray, "vertices joints"],
) -> tuple[
    Float[np.ndarray, "joints 3 3"],
    Float[np.ndarray, " joints"],
    Float[np.ndarray, "joints 3"],
    Float[np.ndarray, "joints 3"],
]:
    """Fit image = centre_image + scale * R (vertex - centre) to each weighted region (Umeyama).

    Returns:
        rotations, scales, centres and image centres; a region without weight stays put.
    """
    mass = regions.sum(axis=0)
    share = regions / np.maximum(mass, 1e-30)
    centres, image_centres = share.T @ vertices, share.T @ images
    products = np.einsum("va,vb->vab", images, vertices).reshape(len(vertices), 9)
    covariance = (share.T @ products).reshape(-1, 3, 3)
    covariance -= image_centres[:, :, None] * centres[:, None, :]
    spread = share.T @ (vertices**2).sum(axis=1) - (centres**2).sum(axis=1)
    rotations = nearest_rotation(covariance + 1e-12 * np.eye(3))
    scales = np.einsum("jab,jab->j", rotations, covariance) / np.maximum(spread, 1e-30)
    empty = (mass <= 1e-12) | (scales <= 0)
    rotations[empty], scales[empty] = np.eye(3), 1.0
    return rotations, scales, centres, image_centres


def carry_joints(
    vertices: Float[np.ndarray, "vertices 3"],
    areas: Float[np.ndarray, " vertices"],
    weights: Float[np.ndarray, "vertices joints"],
    joints: Float[np.ndarray, "joints 3"],
    parents: Int[np.ndarray, " joints"],
    images: Float[np.ndarray, "vertices 3"],
) -> Float[np.ndarray, "joints 3"]:
    """Place every joint on the target, in metres: by similarity, and by regressor where they agree.

    Joints that move no surface (a floor root, poles, finger tips) keep their place beside the
    nearest joint that does.

    Args:
        vertices: source surface at rest, with `areas` and skin `weights`.
        joints: source joints at rest.
        parents: their tree.
        images: where the source's vertices lie on the target.
    """
    rotations, scales, centres, image_centres = fit_similarities(
        vertices, images, region_weights(areas, weights, parents)
    )
    similar = image_centres + scales[:, None] * np.einsum("jab,jb->ja", rotations, joints - centres)
    regressed, known = regress_joints(
        vertices, areas, joint_support(weights, parents), joints, images
    )
    apart = np.linalg.norm(regressed - similar, axis=1)
    known &= apart < FARTHEST_APART * np.linalg.norm(np.ptp(images, axis=0))
    placed = np.where(known[:, None], (regressed + similar) / 2, similar)
    carrier = nearest_moving_joint(areas @ weights > 1e-6 * areas.sum(), parents, joints)
    beside = np.flatnonzero(carrier != np.arange(len(parents)))
    by = carrier[beside]
    offset = np.einsum("jab,jb->ja", rotations[by], joints[beside] - joints[by])
    placed[beside] = placed[by] + scales[by, None] * offset
    return placed


def nearest_moving_joint(
    moves: Bool[np.ndarray, " joints"],
    parents: Int[np.ndarray, " joints"],
    joints: Float[np.ndarray, "joints 3"],
) -> Int[np.ndarray, " joints"]:
    """Give each joint the joint that carries it: itself, or the nearest that moves surface.

    Nearest above it in the tree; for a floor root, below it; for a control that hangs beside the
    body, in space.
    """
    carrier = np.arange(len(parents))
    if not moves.any():
        return np.zeros_like(carrier)
    below, depth = descendants(parents), depths(parents)
    for joint in np.flatnonzero(~moves):
        higher = np.flatnonzero(moves & below[:, joint])
        lower = np.flatnonzero(moves & below[joint])
        if len(higher):
            carrier[joint] = higher[depth[higher].argmax()]
        elif len(lower):
            carrier[joint] = lower[depth[lower].argmin()]
        else:
            away = np.linalg.norm(joints - joints[joint], axis=1)
            carrier[joint] = np.where(moves, away, np.inf).argmin()
    return carrier


def turn_trust(
    areas: Float[np.ndarray, " vertices"], weights: Float[np.ndarray, "vertices joints"]
) -> Float[np.ndarray, " joints"]:
    """Say how far to trust each joint's turn: 0 if it moves no surface, 1 from a hundredth on."""
    return np.minimum(1.0, areas @ weights / areas.sum() / 0.01)

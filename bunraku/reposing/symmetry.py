"""Bodies at rest are symmetric: what is not, once a figure's pose is undone, was still pose."""

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.graphs import root_first
from bunraku.registration.body import Body
from bunraku.registration.mirroring import mirror_twins
from bunraku.types import NO_PARENT

ON_PLANE = 0.02  # of the extent: joints nearer to the plane of symmetry lie on it
ALIKE = 0.25  # of a bone's length: twins of the source that differ by more are none


def symmetry_axis(
    joints: Float[np.ndarray, "joints 3"], vertices: Float[np.ndarray, "vertices 3"]
) -> int:
    """Find the axis across which the source is symmetric, X or Z.

    Of the two vertical planes that is the one whose mirror image of the joints fits best for how
    far they spread across it.
    """
    middle = np.median(joints, axis=0)  # of the surface it would follow a sword in one hand
    extent = float(np.ptp(vertices, axis=0).max())
    doubts = []
    for axis in (0, 2):
        mirrored = joints.copy()
        mirrored[:, axis] = 2 * middle[axis] - joints[:, axis]
        error = np.linalg.norm(mirrored[:, None] - joints, axis=2).min(axis=1).mean()
        doubts.append((error + 2e-3 * extent) / (joints[:, axis].std() + 1e-6 * extent))
    return (0, 2)[int(np.argmin(doubts))]


def straighten(
    places: Float[np.ndarray, "joints 3"], body: Body, share: float
) -> Float[np.ndarray, "joints 3"]:
    """Make the bones of a figure at rest the mean of themselves and their twins' mirror images.

    Left and right legs of one length, a spine in the plane. Only bones that are symmetric in the
    source; the hips stay where they are.

    Args:
        places: joints of the figure, its pose undone, facing the source's front.
        body: the source.
        share: how much of it to do, 0 to 1.
    """
    if share <= 0.0:
        return places
    axis = symmetry_axis(body.joints, body.proxy.mesh.vertices)
    twin, symmetric = twin_bones(body, axis)
    bones = places - places[body.carriers]
    mirrored = bones[twin]
    mirrored[:, axis] *= -1.0
    bones = np.where(symmetric[:, None], bones + share * (mirrored - bones) / 2, bones)
    return chain_bones(bones, places, body)


def chain_bones(
    bones: Float[np.ndarray, "joints 3"], places: Float[np.ndarray, "joints 3"], body: Body
) -> Float[np.ndarray, "joints 3"]:
    """Place joints by the way from each one's carrier, the hips where they were."""
    placed = places.copy()
    for joint in root_first(body.carriers):
        if body.carriers[joint] != NO_PARENT:
            placed[joint] = placed[body.carriers[joint]] + bones[joint]
    hips = body.puppet.joints[0]
    return placed + (places[hips] - placed[hips])


def twin_bones(
    body: Body, axis: int
) -> tuple[Int[np.ndarray, " joints"], Bool[np.ndarray, " joints"]]:
    """Give each joint its twin (itself on the plane), and tell which bones the source mirrors."""
    joints, carriers = body.joints, body.carriers
    extent = float(np.ptp(joints, axis=0).max())
    each = np.arange(len(joints))
    twin = mirror_twins(joints, axis=axis)
    paired = twin != each
    paired |= np.abs(joints[:, axis] - np.median(joints[:, axis])) < ON_PLANE * extent
    bones = joints - joints[carriers]
    mirrored = bones[twin]
    mirrored[:, axis] *= -1.0
    length = np.maximum(np.linalg.norm(bones, axis=1), ON_PLANE * extent)
    same = np.linalg.norm(bones - mirrored, axis=1) < ALIKE * length
    hung = (carriers != NO_PARENT) & (carriers[twin] == twin[carriers])
    return twin, paired & paired[carriers] & hung & same

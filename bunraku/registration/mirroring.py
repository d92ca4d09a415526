"""The source's own mirror: which joints are twins, and poses with twin limbs swapped.

Closest points cannot tell a left leg behind from a right leg behind: caught in a run, a fit falls
into either. The other one is a swap away.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from bunraku.registration.puppet import Pose, Puppet
from bunraku.types import NO_PARENT

LEAST_LIMB = 0.04  # of the surface: ears and thumbs are not worth a trial
NEAR = 0.1  # of the extent of the joints: farther images are none
MIRROR = np.diag([-1.0, 1.0, 1.0])


def mirror_twins(
    points: Float[np.ndarray, "points 3"], *, axis: int = 0
) -> Int[np.ndarray, " points"]:
    """Give each point its mirror image across the median plane; itself if it has none.

    An image within a tenth of the extent will do: bodies are never quite symmetric.

    Args:
        points: joints, or anchors, of a body at rest.
        axis: across which it is mirrored, from left to right.
    """
    own, image = np.arange(len(points)), points.copy()
    image[:, axis] = 2 * float(np.median(points[:, axis])) - points[:, axis]
    away = np.linalg.norm(image[:, None] - points, axis=2)
    twin, near = away.argmin(axis=1), away.min(axis=1) < NEAR * np.ptp(points, axis=0).max()
    return np.where((twin[twin] == own) & near, twin, own)


def swap_limbs(puppet: Puppet, pose: Pose) -> Iterator[Pose]:
    """Give the pose with each pair of twin limbs swapped at their tops: legs, arms, hind legs.

    Below its top a swapped limb is straight: bent as the wrong one was, it bends the wrong way.
    The root's place, the trunk and the other limbs stay as they are.
    """
    twin = mirror_twins(puppet.anchors)
    off = twin != np.arange(len(twin))
    share = puppet.below @ (puppet.areas @ puppet.weights)
    for limb in np.flatnonzero(off & (share > LEAST_LIMB)):
        above = puppet.parents[limb]
        if limb > twin[limb] or (above != NO_PARENT and off[above]):
            continue
        both = off & ((puppet.below[limb] + puppet.below[twin[limb]]) > 0)
        rotations, scales = pose.rotations.copy(), pose.scales.copy()
        tops = [limb, twin[limb]]
        rotations[both] = np.eye(3)
        rotations[tops] = MIRROR @ pose.rotations[twin[tops]] @ MIRROR
        scales[both] = pose.scales[twin[both]]
        yield Pose(pose.root, rotations, scales)

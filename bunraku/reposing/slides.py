"""Joints that slide against the joints that carry them: squash and stretch, shoulders, IK feet.

A figure caught in motion has slid as well as turned. Which slides go with which turns the
source's own clips tell: ridge regression of the one by the other, from rest, which is neither.
"""

import numpy as np
from jaxtyping import Float

from bunraku.registration.body import Body
from bunraku.reposing.symmetry import chain_bones
from bunraku.rotations import matrices_to_vectors
from bunraku.types import NO_PARENT

RIDGE = 0.02  # of the mean squared turn: what a moment must stand out from
MOST_MOMENTS = 400  # that the regression learns from
LEAST_STRETCH = 1e-4  # of volume: what a clip makes smaller, it hides
LEAST_SHARE = 4e-3  # of the surface: what joints with less do was not seen


def undo_slides(
    places: Float[np.ndarray, "joints 3"],
    body: Body,
    turns: Float[np.ndarray, "joints 3 3"],
    share: float,
) -> Float[np.ndarray, "joints 3"]:
    """Take back how far a figure's joints have slid, as the source's clips let expect.

    Args:
        places: joints of the figure, its turns undone, facing the source's front.
        body: the source.
        turns: of each joint from rest to the figure as found, world, heading left out.
        share: how much of it to do, 0 to 1.
    """
    if share <= 0.0 or not len(body.moments.turns):
        return places
    kept = body.puppet.joints
    spread = [np.linalg.norm(points[kept] - points[kept[0]]) for points in (places, body.joints)]
    scale = spread[0] / spread[1] if spread[1] > 0 else 1.0
    bones = places - places[body.carriers] - share * scale * expected_slides(body, turns)
    return chain_bones(bones, places, body)


def expected_slides(
    body: Body, turns: Float[np.ndarray, "joints 3 3"]
) -> Float[np.ndarray, "joints 3"]:
    """Say how far each joint slides on its carrier when the source's joints are turned so.

    Returns:
        slides in the source's metres, along the axes of its rest pose.
    """
    every = max(1, -(-len(body.moments.turns) // MOST_MOMENTS))
    known, asked = bent(body.moments.turns[::every], body), bent(turns[None], body)
    kernel = known @ known.T
    strength = float(np.trace(kernel)) / len(kernel)
    if strength <= 1e-12:
        return np.zeros_like(body.joints)
    system = kernel + RIDGE * strength * np.eye(len(kernel))
    shares = np.linalg.solve(system, known @ asked[0])
    return np.einsum("m,mja->ja", shares, slides_at_moments(body, every))


def slides_at_moments(body: Body, every: int) -> Float[np.ndarray, "moments joints 3"]:
    """Measure how far each joint has slid on its carrier, in the carrier's own axes and stretch.

    What a clip scales to nothing, to hide it, has not slid.

    Args:
        body: the source.
        every: one moment in how many is looked at.
    """
    linear, places = body.moments.linear[::every], body.moments.places[::every]
    above = linear[:, body.carriers]
    there = (np.abs(np.linalg.det(above)) > LEAST_STRETCH) & (body.carriers != NO_PARENT)
    undo = np.linalg.inv(np.where(there[:, :, None, None], above, np.eye(3)))
    bones = np.einsum("mjab,mjb->mja", undo, places - places[:, body.carriers])
    slides = bones - (body.joints - body.joints[body.carriers])
    return np.where(there[:, :, None], slides, 0.0)


def bent(
    turns: Float[np.ndarray, "moments joints 3 3"], body: Body
) -> Float[np.ndarray, "moments features"]:
    """Describe moments by each joint's turn on its carrier, weighed by the surface it moves.

    A root turns on nothing: which way the whole body looks says nothing.
    """
    mass = body.areas @ body.weights
    mass = mass / mass.sum()
    seen = (mass > LEAST_SHARE) & (body.carriers != NO_PARENT)
    own = np.swapaxes(turns[:, body.carriers[seen]], 2, 3) @ turns[:, seen]
    return (matrices_to_vectors(own) * np.sqrt(mass[seen])[:, None]).reshape(len(turns), -1)

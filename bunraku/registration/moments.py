"""Moments of a character's clips: how its joints turn and where they go, since rest."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.meshes import farthest_points
from bunraku.rotations import decompose_transforms, nearest_rotation
from bunraku.skinning import clip_transforms, forward_kinematics
from bunraku.types import Character


@dataclass(frozen=True, eq=False)
class Moments:
    """A character's joints at moments of its clips."""

    turns: Float[np.ndarray, "moments joints 3 3"]  # world, since rest
    linear: Float[np.ndarray, "moments joints 3 3"]  # the same with what stretches them
    places: Float[np.ndarray, "moments joints 3"]  # world, in metres
    unlike: Int[np.ndarray, " unlike"]  # a few moments that differ most from each other


def no_moments(count: int) -> Moments:
    """Give what a character of so many joints shows without clips."""
    turns = np.empty((0, count, 3, 3))
    return Moments(turns, turns, np.empty((0, count, 3)), np.arange(0))


def look_at_clips(
    source: Character, mass: Float[np.ndarray, " joints"], *, count: int = 24, each: int = 8
) -> Moments:
    """Look at a character's clips, a few frames of each.

    Args:
        mass: how much surface each joint moves; moments differ by what they show.
        count: unlike moments to choose at most.
        each: moments looked at in each clip.
    """
    if not source.clips:
        return no_moments(len(mass))
    rest = forward_kinematics(source.skeleton.parents, source.skeleton.rest)[:, :3, :3]
    at_rest = nearest_rotation(rest)
    sound = np.abs(np.linalg.det(rest)) > 1e-9
    undo = np.linalg.inv(np.where(sound[:, None, None], rest, at_rest))
    places, turns, linear = [], [], []
    for clip in source.clips:
        frames = np.unique(np.linspace(0, len(clip.times) - 1, each).astype(int))
        frame = forward_kinematics(source.skeleton.parents, clip_transforms(clip, frames))
        place, world, _ = decompose_transforms(frame)
        places.append(place)
        turns.append(world @ np.swapaxes(at_rest, 1, 2))
        linear.append(frame[..., :3, :3] @ undo)
    looked = np.concatenate(turns)
    spread = (looked * np.sqrt(mass / mass.sum())[:, None, None]).reshape(len(looked), -1)
    parts = np.concatenate(linear), np.concatenate(places)
    return Moments(looked, *parts, farthest_points(spread, count))

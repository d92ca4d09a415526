"""Poses that may be learnt from: the built-in human's clips, mixed and shaken; drawn angles.

Every second clip is learnt from; the others are kept for tests. People's poses are told from a rest
pose with arms hanging FALL degrees below the horizontal, whatever the rest pose of a body.
"""

import numpy as np
from jaxtyping import Float

from bunraku.neural.anatomy import PERSON, Anatomy
from bunraku.neural.variation import arm_turns, chain_turns
from bunraku.rotations import vectors_to_matrices
from bunraku.skinning import clip_transforms, forward_kinematics
from bunraku.types import Character

FALL = 45.0


def draw_turns(
    known: Float[np.ndarray, "known parts 3 3"],
    anatomy: Anatomy,
    count: int,
    rng: np.random.Generator,
) -> Float[np.ndarray, "poses parts 3 3"]:
    """Draw poses to learn from: turns of parts relative to their parents; the root's is none.

    Args:
        known: poses to mix and shake; without any, angles are drawn.
    """
    limit = np.array([0.35 if "Leg" in n or "Foot" in n else 0.2 for n in anatomy.names])
    strength = rng.uniform(0.2, 1.2, (count, 1, 1))
    shaken = rng.normal(0, 1, (count, len(limit), 3)) * limit[:, None] * [1.0, 0.4, 0.4]
    own = vectors_to_matrices(strength * shaken)
    if len(known):
        first, second = (known[rng.integers(0, len(known), count)] for _ in range(2))
        upper = np.array([not n.endswith(("hips", "Leg", "Foot")) for n in anatomy.names])
        mixed = ((rng.random(count) < 0.4)[:, None] & upper)[..., None, None]
        own = np.where(mixed, second, first) @ vectors_to_matrices(0.25 * strength * shaken)
    own[:, 0] = np.eye(3)
    return own


def known_turns(human: Character) -> Float[np.ndarray, "known parts 3 3"]:
    """Give the poses of the clips that may be learnt from: turns of parts relative to parents."""
    raised = stance(_joints(human), PERSON)
    worlds = [turns @ raised.swapaxes(-1, -2) for turns, _ in clip_turns(human)]
    return relative_turns(np.concatenate(worlds), PERSON)


def clip_turns(
    human: Character, *, kept_for_tests: bool = False
) -> list[tuple[Float[np.ndarray, "frames parts 3 3"], Float[np.ndarray, "frames 3"]]]:
    """Give clips of the built-in human: turns of parts in the world since its rest, ways of hips.

    Ways are in heights of the hips.

    Args:
        human: whose joint frames are aligned with the world at rest.
        kept_for_tests: the clips that nothing learns from; else the others.
    """
    at = [human.skeleton.names.index(name) for name in PERSON.names]
    rest = human.skeleton.rest[at[0], :3, 3]
    found = []
    for clip in human.clips[int(kept_for_tests) :: 2]:
        local = clip_transforms(clip, np.arange(len(clip.times)))
        world = forward_kinematics(human.skeleton.parents, local)
        found.append((world[:, at, :3, :3], (world[:, at[0], :3, 3] - rest) / rest[1]))
    return found


def _joints(human: Character) -> Float[np.ndarray, "parts 3"]:
    """Give where the joints of the human's parts are at rest."""
    world = forward_kinematics(human.skeleton.parents, human.skeleton.rest)
    return world[[human.skeleton.names.index(name) for name in PERSON.names], :3, 3]


def relative_turns(
    world: Float[np.ndarray, "poses parts 3 3"], anatomy: Anatomy
) -> Float[np.ndarray, "poses parts 3 3"]:
    """Give turns relative to parents, of turns in the world."""
    above = np.maximum(anatomy.parents, 0)
    own = np.swapaxes(world[:, above], -1, -2) @ world
    own[:, 0] = world[:, 0]
    return own


def stance(
    joints: Float[np.ndarray, "parts 3"], anatomy: Anatomy, *, fall: float = FALL
) -> Float[np.ndarray, "parts 3 3"]:
    """Turn a person's arms from its rest pose so many degrees below the horizontal.

    Turns in the world; quadrupeds all stand alike.
    """
    if anatomy.kind != PERSON.kind:
        return np.tile(np.eye(3), (len(joints), 1, 1))
    return chain_turns(anatomy, arm_turns(joints, anatomy, fall))

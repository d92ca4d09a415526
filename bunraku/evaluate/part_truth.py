"""The true parts of rigged people: the strongest joint of each vertex, read by its name."""

import numpy as np
from jaxtyping import Float, Int

from bunraku.evaluate.families import bind_joints
from bunraku.humanoids.naming import name_joints
from bunraku.neural.anatomy import PERSON
from bunraku.types import NO_PARENT, Character, Skeleton

_SAME = {"Toes": "Foot"}


def part_of_joints(skeleton: Skeleton) -> Int[np.ndarray, " joints"]:
    """Give the part that each joint of a human rig belongs to: its own, or its ancestor's.

    Joints above the hips, and what hangs on none, count as hips.

    Raises:
        MatchError: if the rig shows no two legs and two arms.
    """
    parts = np.full(len(skeleton.names), NO_PARENT)
    for bone, joint in name_joints(skeleton).items():
        for old, new in _SAME.items():
            bone = bone.replace(old, new)
        if bone in PERSON.names:
            parts[joint] = PERSON.index(bone)
    for joint, parent in enumerate(skeleton.parents):
        if parts[joint] == NO_PARENT:
            parts[joint] = parts[parent] if parent != NO_PARENT else PERSON.index("hips")
    return parts


def true_parts(character: Character) -> Int[np.ndarray, " vertices"]:
    """Give the part of each vertex of a rigged person: that of its strongest joint."""
    parts = part_of_joints(character.skeleton)
    return np.asarray(parts[character.skin.weights.argmax(axis=1)])


def true_joints(character: Character) -> Float[np.ndarray, "parts 3"]:
    """Give where the joint of each part is in the bind pose; nan for parts the rig has not."""
    places, named = bind_joints(character), name_joints(character.skeleton)
    found = np.full((len(PERSON.names), 3), np.nan)
    for part, name in enumerate(PERSON.names):
        if name in named:
            found[part] = places[named[name]]
    return found


def merge_spine(
    labels: Int[np.ndarray, " vertices"], present: Int[np.ndarray, " present"]
) -> Int[np.ndarray, " vertices"]:
    """Read parts that a rig has not as the nearest ancestor that it has.

    Args:
        labels: parts of PERSON.
        present: parts that the rig has joints of.
    """
    table = np.arange(len(PERSON.names))
    for part, parent in enumerate(PERSON.parents):
        if part not in present and parent != NO_PARENT:
            table[part] = table[parent]
    return np.asarray(table[labels])

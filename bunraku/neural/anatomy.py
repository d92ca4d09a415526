"""The parts of which bodies are made here, and how they hang together: people and quadrupeds.

Each part has one joint, where it begins: the part turns about it. Parents come before children.
People's parts carry the names of VRM 1.0 bones; fingers belong to hands, toes to feet.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Int

from bunraku.types import NO_PARENT

_SIDES = ("left", "right")


@dataclass(frozen=True)
class Anatomy:
    """The tree of a kind's parts."""

    kind: str
    names: tuple[str, ...]
    parent_names: tuple[str, ...]  # empty for the root

    @cached_property
    def parents(self) -> Int[np.ndarray, " parts"]:
        """Give the parent of each part; NO_PARENT for the root."""
        index = {name: i for i, name in enumerate(self.names)}
        return np.array([index.get(name, NO_PARENT) for name in self.parent_names], np.int64)

    @cached_property
    def twins(self) -> Int[np.ndarray, " parts"]:
        """Give the part on the other side of each part; a middle one is its own."""
        swapped = [_other_side(name) for name in self.names]
        return np.array([self.names.index(name) for name in swapped], np.int64)

    @cached_property
    def children(self) -> Int[np.ndarray, " parts"]:
        """Give the part that goes on where each part ends; NO_PARENT for a tip."""
        main = {name: NO_PARENT for name in range(len(self.names))}
        for child, parent in reversed(list(enumerate(self.parents))):
            if parent != NO_PARENT and self.names[child] not in _BRANCHES:
                main[int(parent)] = child
        return np.array(list(main.values()), np.int64)

    def index(self, name: str) -> int:
        """Give the number of a part."""
        return self.names.index(name)


def _other_side(name: str) -> str:
    for side, other in (_SIDES, _SIDES[::-1]):
        if name.startswith(side):
            return other + name.removeprefix(side)
    return name


def _limbs(roots: dict[str, tuple[str, ...]]) -> tuple[tuple[str, str], ...]:
    """Name the parts of each limb on both sides, with their parents."""
    found = []
    for side in _SIDES:
        for root, chain in roots.items():
            above = root
            for part in chain:
                found.append((side + part, above))
                above = side + part
    return tuple(found)


_PERSON = (
    *(("hips", ""), ("spine", "hips"), ("chest", "spine"), ("upperChest", "chest")),
    *(("neck", "upperChest"), ("head", "neck")),
    *_limbs(
        {
            "upperChest": ("Shoulder", "UpperArm", "LowerArm", "Hand"),
            "hips": ("UpperLeg", "LowerLeg", "Foot"),
        }
    ),
)
_QUADRUPED = (
    *(("hips", ""), ("spine", "hips"), ("chest", "spine"), ("neck", "chest"), ("head", "neck")),
    *(("tail", "hips"), ("tailTip", "tail")),
    *_limbs(
        {
            "chest": ("FrontUpperLeg", "FrontLowerLeg", "FrontFoot"),
            "hips": ("HindUpperLeg", "HindLowerLeg", "HindFoot"),
        }
    ),
)
# parts that begin somewhere on the side of their parent, not where it ends
_BRANCHES = {
    *(side + part for side in _SIDES for part in ("Shoulder", "UpperLeg")),
    *(side + end + "UpperLeg" for side in _SIDES for end in ("Front", "Hind")),
    "tail",
}
PERSON, QUADRUPED = (
    Anatomy(kind, *zip(*parts, strict=True))
    for kind, parts in (("person", _PERSON), ("quadruped", _QUADRUPED))
)
ANATOMIES = {anatomy.kind: anatomy for anatomy in (PERSON, QUADRUPED)}

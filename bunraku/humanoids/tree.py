"""A skeleton as a tree: ancestors, branches, lengths."""

import numpy as np
from jaxtyping import Float, Int

from bunraku.skinning import forward_kinematics
from bunraku.types import NO_PARENT, Skeleton


class Tree:
    """The shape of a skeleton in its rest pose, looked at from its joints."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.parents: list[int] = skeleton.parents.tolist()
        rest = forward_kinematics(skeleton.parents, skeleton.rest)
        self.places: Float[np.ndarray, "joints 3"] = rest[:, :3, 3]
        self.children: list[list[int]] = [[] for _ in self.parents]
        for joint, parent in enumerate(self.parents):
            if parent != NO_PARENT:
                self.children[parent].append(joint)
        above = np.where(skeleton.parents == NO_PARENT, np.arange(len(rest)), skeleton.parents)
        self.lengths: Float[np.ndarray, " joints"] = np.linalg.norm(
            self.places - self.places[above], axis=1
        )
        self.reach, self.sizes = self._measure_branches()

    def _measure_branches(self) -> tuple[Float[np.ndarray, " joints"], Int[np.ndarray, " joints"]]:
        """Measure each joint's longest way down to a leaf, and count the joints below it."""
        reach, sizes = np.zeros(len(self.parents)), np.ones(len(self.parents), np.int64)
        for joint in reversed(range(len(self.parents))):
            parent = self.parents[joint]
            if parent != NO_PARENT:
                reach[parent] = max(reach[parent], reach[joint] + self.lengths[joint])
                sizes[parent] += sizes[joint]
        return reach, sizes

    def ancestors(self, joint: int) -> list[int]:
        """List the joints above one, nearest first."""
        above = []
        while (joint := self.parents[joint]) != NO_PARENT:
            above.append(joint)
        return above

    def chain(self, joint: int) -> list[int]:
        """List a joint and those above it, root first."""
        return [*reversed(self.ancestors(joint)), joint]

    def longest_chain(self, joint: int) -> list[int]:
        """List a joint and those below it along the longest branch."""
        chain = [joint]
        while self.children[chain[-1]]:
            chain.append(
                max(self.children[chain[-1]], key=lambda j: self.reach[j] + self.lengths[j])
            )
        return chain

    def junction(self, joints: list[int]) -> int:
        """Find the lowest joint that is above (or is) all of these; NO_PARENT if there is none."""
        common = self.chain(joints[0])
        for joint in joints[1:]:
            chain = set(self.chain(joint))
            common = [ancestor for ancestor in common if ancestor in chain]
        return common[-1] if common else NO_PARENT

    def below(self, joint: int) -> list[int]:
        """List the joints below one, parents first."""
        inside = {joint}
        for other in range(joint + 1, len(self.parents)):
            if self.parents[other] in inside:
                inside.add(other)
        return sorted(inside - {joint})

"""What a figure is taken for: its kind, which parts move its vertices, where the joints are."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from bunraku.neural.anatomy import ANATOMIES, Anatomy
from bunraku.types import Mesh


@dataclass(frozen=True, eq=False)
class Understanding:
    """What the network takes a figure for, in the figure's own place and metres."""

    kind: str
    chance: float  # of that kind, 0 to 1
    weights: Float[np.ndarray, "vertices parts"]
    joints: Float[np.ndarray, "parts 3"]
    agreement: float  # between readings: how far they put the same vertex into the same part

    @property
    def anatomy(self) -> Anatomy:
        """Give the tree of the figure's parts."""
        return ANATOMIES[self.kind]

    @property
    def labels(self) -> Int[np.ndarray, " vertices"]:
        """Give the strongest part of each vertex."""
        return np.asarray(self.weights.argmax(axis=1))


@runtime_checkable
class Reader(Protocol):
    """Whoever understands figures: a trained network, or in tests, somebody who knows."""

    def __call__(self, mesh: Mesh, *, kind: str | None = None) -> Understanding:
        """Understand a figure at rest, Y up, facing +Z; of a given kind if that is known."""


def standing_height(mesh: Mesh, joints: Float[np.ndarray, "parts 3"]) -> float:
    """Give the height of the hips over the ground."""
    return max(float(joints[0, 1] - mesh.vertices[:, 1].min()), 1e-6)

"""Figure and performer side by side, and the colours that show what one has from the other."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku.studio.colouring import colour_joints, colour_places, colour_weights
from bunraku.types import Character

Colours = Float[np.ndarray, "_ 3"]
AS_FOUND, BY_MAP, BY_JOINT, BY_WEIGHT = PAINTS = (
    "as found",
    "map: same colour, same place",
    "parts: the strongest joint",
    "weights of one joint",
)


@dataclass(frozen=True, eq=False)
class Cast:
    """Who is on the stage."""

    figure: Character
    performer: Character
    counterparts: Float[np.ndarray, "vertices 3"] | None  # on the performer at rest; None: no map

    def paint(self, paint: str, joint: str) -> tuple[Colours, Colours] | tuple[None, None]:
        """Colour the vertices of both; as found, and without a map to show, neither.

        Args:
            paint: one of PAINTS.
            joint: whose weights to show; all cold for one that is not there.
        """
        if paint == AS_FOUND:
            return None, None
        if paint == BY_MAP:
            if self.counterparts is None:
                return None, None
            rest = self.performer.mesh.vertices
            return colour_places(self.counterparts, rest), colour_places(rest, rest)
        if paint == BY_JOINT:
            strongest = self.figure.skin.weights.argmax(axis=1)
            return colour_joints(strongest), colour_joints(self._performers_joints())
        return _weights_of(self.figure, joint), _weights_of(self.performer, joint)

    def _performers_joints(self) -> Int[np.ndarray, " performer_vertices"]:
        """Number the performer's vertices by its strongest joints, as the figure counts them."""
        known = {name: number for number, name in enumerate(self.figure.skeleton.names)}
        numbers = [known.get(name, 0) for name in self.performer.skeleton.names]
        return np.array(numbers)[self.performer.skin.weights.argmax(axis=1)]


def _weights_of(who: Character, joint: str) -> Colours:
    """Colour vertices by how much a joint moves them."""
    if joint not in who.skeleton.names:
        return colour_weights(np.zeros(len(who.mesh.vertices)))
    return colour_weights(who.skin.weights[:, who.skeleton.names.index(joint)])


def find_counterparts(
    character: Character, stored: Float[np.ndarray, "2 stored_vertices 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Look up the counterparts of a figure that was read back from its file.

    Args:
        character: the figure.
        stored: vertices of the figure as it was animated, and their counterparts.
    """
    return stored[1][KDTree(stored[0]).query(character.mesh.vertices)[1]].astype(np.float64)


def describe(confidence: float) -> str:
    """Say in plain words how far to trust a result."""
    if confidence >= 0.8:
        return "The figure fits the performer well."
    if confidence >= 0.5:
        return "The fit is fair: look at hands, feet and head."
    return "The fit is poor: look at every limb; *Move joints*, below, puts some of it right."

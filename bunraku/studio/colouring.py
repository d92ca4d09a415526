"""Colours of vertices that show what was found: the map, the parts, the weights of a joint."""

import colorsys

import numpy as np
from jaxtyping import Float, Int

COLD, WARM = np.array([40.0, 70.0, 200.0]), np.array([230.0, 60.0, 30.0])
GOLDEN = 0.618034  # turns of the colour circle from one joint to the next


def colour_places(
    places: Float[np.ndarray, "vertices 3"], rest: Float[np.ndarray, "performer_vertices 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Colour places on a performer at rest: red to its left, green above, blue in front.

    Args:
        places: the performer's own vertices, or a figure's carried there by the map.
        rest: the performer's own vertices, whose box holds all the colours.
    """
    low, size = rest.min(axis=0), np.maximum(np.ptp(rest, axis=0), 1e-9)
    return 30.0 + 225.0 * np.clip((places - low) / size, 0.0, 1.0)


def colour_joints(numbers: Int[np.ndarray, " vertices"]) -> Float[np.ndarray, "vertices 3"]:
    """Colour vertices by the number of a joint; joints next to each other are far apart."""
    kinds, which = np.unique(numbers, return_inverse=True)
    circle = [((GOLDEN * kind) % 1.0, 0.5 + 0.2 * (kind % 3)) for kind in kinds.tolist()]
    return 255.0 * np.array([colorsys.hls_to_rgb(hue, 0.55, vivid) for hue, vivid in circle])[which]


def colour_weights(weights: Float[np.ndarray, " vertices"]) -> Float[np.ndarray, "vertices 3"]:
    """Go from cold, where a joint moves nothing, to warm."""
    return (1 - weights[:, None]) * COLD + weights[:, None] * WARM

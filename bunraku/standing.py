"""Where a figure stands: its ground, how far it travels, and its way home.

A figure caught in motion may hang in the air, or lie; a clip expects it on the floor of its file.
"""

import numpy as np
from jaxtyping import Float

from bunraku.errors import doubt
from bunraku.graphs import descendants
from bunraku.registration.body import Body
from bunraku.reposing import symmetry_axis
from bunraku.reposing.decision import is_stood_on, limbs

LEAST_TRAVEL = 0.25  # of the ratio of heights: legs shorter than that are a joint gone astray


def ground_under(
    rested: Float[np.ndarray, "vertices 3"],
    weights: Float[np.ndarray, "vertices joints"],
    body: Body,
) -> float:
    """Find the ground a figure stands on: its lowest point, or how low most of its limbs reach.

    Of three limbs or more that a body stands on some may have been put wrongly, and hang down.

    Args:
        rested: the figure's vertices in the source's rest pose.
        weights: its skin.
        body: the source.
    """
    below = descendants(body.carriers)
    stood_on = [below[limb] for limb in limbs(body).tolist() if is_stood_on(body, limb)]
    own = [weights[:, limb].sum(axis=1) > 0.5 for limb in stood_on]
    lows = [float(rested[limb, 1].min()) for limb in own if limb.any()]
    return float(np.median(lows) if len(lows) > 2 else rested[:, 1].min())


def travel_scale(
    hips: tuple[float, float],
    heights: tuple[Float[np.ndarray, " source_vertices"], Float[np.ndarray, " figure_vertices"]],
) -> float:
    """Compare the heights of two hips over their ground, within reason for bodies of these heights.

    Hips lie inside a body: a figure's are at most as high as the figure, and legs of the source's
    kind are at least a quarter as long as its height lets expect. A joint gone astray must not
    make a figure fly.

    Args:
        hips: height of the hips of source and figure at rest, in metres.
        heights: of the vertices of source and figure at rest.
    """
    low, high = np.array([(y.min(), y.max()) for y in heights]).T
    tall, above = high - low, np.array(hips) - low
    if min(tall[0], tall[1], above[0]) <= 1e-6:
        return 1.0
    expected = tall[1] / tall[0]
    most = max(expected, float(tall[1] / above[0]))
    scale = float(np.clip(above[1] / above[0], LEAST_TRAVEL * expected, most))
    if scale != above[1] / above[0]:
        doubt("no body of this height has its hips where they were found; travel is a guess")
    return scale


def way_aside(
    body: Body,
    heading: Float[np.ndarray, "3 3"],
    hips: Float[np.ndarray, "3"],
    middle: Float[np.ndarray, "3"],
    *,
    scale: float,
    alike: bool,
) -> Float[np.ndarray, "3"]:
    """Say how far a figure caught in motion is from where the source stands at rest.

    The hips tell it of a body like the source. Those of another lie farther back or in front by
    nature: there the middle of the surface must bear them out, and the lesser way counts; to the
    side they are right, because bodies are symmetric.

    Args:
        body: the source.
        heading: turn about the vertical from the source's front to the figure's.
        hips: of the figure at rest.
        middle: of its surface at rest.
        scale: figure to source.
        alike: the figure is like the source.
    """
    areas, vertices = body.areas, body.proxy.mesh.vertices
    by_hips = scale * body.joints[body.puppet.joints[0]] - hips @ heading
    if alike:
        return heading @ by_hips
    by_surface = scale * (areas @ vertices) / areas.sum() - middle @ heading
    agreed = np.where(by_hips * by_surface > 0, np.minimum(abs(by_hips), abs(by_surface)), 0.0)
    aside = np.sign(by_hips) * agreed
    across = symmetry_axis(body.joints, vertices)
    aside[across] = by_hips[across]
    return np.asarray(heading @ aside)


def way_home(
    found: Float[np.ndarray, "vertices 3"],
    rested: Float[np.ndarray, "vertices 3"],
    aside: Float[np.ndarray, "3"],
    *,
    posed: bool,
) -> Float[np.ndarray, "3"]:
    """Say how to move a reposed figure so that it stands where clips expect it.

    A figure found at rest stays on its own ground. One caught in motion, near the origin of its
    file, perhaps in the air, goes to the floor y = 0 and to where the source stands at rest.

    Args:
        found: the figure's vertices as found.
        rested: the same in the source's rest pose.
        aside: way to where the source stands, from `way_aside`.
        posed: the figure was caught in motion.
    """
    floor, height = float(found[:, 1].min()), float(np.ptp(rested[:, 1]))
    shift = np.zeros(3)
    if posed and -0.3 * height < floor < 0.8 * height:
        floor = 0.0
        level = aside * [1.0, 0.0, 1.0]
        shift += level if np.linalg.norm(level) < 0.35 * height else 0.0
    shift[1] = floor - float(rested[:, 1].min())
    return shift

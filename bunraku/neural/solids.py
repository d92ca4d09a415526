"""Rounded solids with part weights along their axis: what sculpted bodies are put together from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.neural.bodies import Body
from bunraku.types import Mesh

RINGS, SEGMENTS = 9, 12


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed piece of a body."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    weights: Float[np.ndarray, "vertices parts"]


@dataclass(frozen=True)
class Share:
    """Which parts move a solid: one after the other along its axis, passing over at the bounds."""

    parts: tuple[int, ...]
    bounds: tuple[float, ...]  # along the axis from its start, in metres; one less than parts
    softness: float  # how wide each passage is, in metres


def unit_solid(
    exponent: float, taper: float
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Make a superellipsoid of half axes 1 about the Y axis.

    Args:
        exponent: 1 is a ball, towards 0 a box.
        taper: how much wider its lower end is than its upper one; 0 for none.
    """
    polar = np.linspace(-np.pi / 2, np.pi / 2, RINGS + 2)[1:-1]
    around = np.linspace(0, 2 * np.pi, SEGMENTS, endpoint=False)
    wide, high = _power(np.cos(polar), exponent), _power(np.sin(polar), exponent)
    ring = np.stack([_power(np.cos(around), exponent), _power(np.sin(around), exponent)], axis=1)
    body = np.zeros((RINGS, SEGMENTS, 3))
    body[..., [0, 2]] = wide[:, None, None] * ring
    body[..., 1] = high[:, None]
    vertices = np.concatenate([body.reshape(-1, 3), [[0, -1.0, 0], [0, 1.0, 0]]])
    vertices[:, [0, 2]] *= (1 - taper * vertices[:, 1:2]) / (1 + abs(taper))
    grid = np.arange(RINGS * SEGMENTS).reshape(RINGS, SEGMENTS)
    following = np.roll(grid, -1, axis=1)
    low, right, high_, far = (
        *(grid[:-1].ravel(), following[:-1].ravel()),
        *(grid[1:].ravel(), following[1:].ravel()),
    )
    bottom, top = RINGS * SEGMENTS, RINGS * SEGMENTS + 1
    caps = [
        np.stack([np.full(SEGMENTS, bottom), grid[0], following[0]], axis=1),
        np.stack([following[-1], grid[-1], np.full(SEGMENTS, top)], axis=1),
    ]
    sides = [np.stack([low, high_, right], axis=1), np.stack([right, high_, far], axis=1)]
    return vertices, np.concatenate([*sides, *caps])


def _power(values: np.ndarray, exponent: float) -> np.ndarray:
    return np.sign(values) * np.abs(values) ** exponent


def place_solid(
    ends: Float[np.ndarray, "2 3"],
    radii: tuple[float, float],
    share: Share,
    part_count: int,
    *,
    overhang: tuple[float, float] = (0.0, 0.0),
    form: tuple[float, float] = (1.0, 0.0),
) -> Solid:
    """Put a solid along an axis.

    Args:
        ends: of the axis: from, to.
        radii: half its width across (mostly along X) and deep (mostly along Z, or Y).
        share: which parts move it.
        overhang: how far it reaches over both ends of the axis.
        form: exponent and taper of `unit_solid`.
    """
    unit, faces = unit_solid(*form)
    axis = ends[1] - ends[0]
    length = max(float(np.linalg.norm(axis)), 1e-6)
    along = axis / length
    across = np.array([1.0, 0, 0]) if abs(along[0]) < 0.8 else np.array([0, 0, 1.0])
    across = across - along * (across @ along)
    across /= np.linalg.norm(across)
    deep = np.cross(across, along)
    half = (length + sum(overhang)) / 2
    middle = ends[0] + along * (half - overhang[0])
    vertices = (
        middle
        + np.outer(unit[:, 0] * radii[0], across)
        + np.outer(unit[:, 1] * half, along)
        + np.outer(unit[:, 2] * radii[1], deep)
    )
    weights = np.zeros((len(vertices), part_count))
    weights[:, share.parts] = ramp_weights((vertices - ends[0]) @ along, share)
    return Solid(vertices, faces, weights)


def ramp_weights(
    place: Float[np.ndarray, " points"], share: Share
) -> Float[np.ndarray, "points shares"]:
    """Pass from one part to the next at each bound, linearly over the softness."""
    bounds = np.array(share.bounds).reshape(1, -1)
    passed = np.clip((place[:, None] - bounds) / max(share.softness, 1e-6) + 0.5, 0, 1)
    edges = np.column_stack([np.ones(len(place)), np.minimum.accumulate(passed, axis=1)])
    return edges - np.column_stack([edges[:, 1:], np.zeros(len(place))])


def assemble(
    family: str, kind: str, solids: Sequence[Solid], joints: Float[np.ndarray, "parts 3"]
) -> Body:
    """Put solids together into one body of many pieces."""
    starts = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    faces = [solid.faces + start for solid, start in zip(solids, starts, strict=False)]
    return Body(
        family,
        kind,
        Mesh(np.concatenate([solid.vertices for solid in solids]), np.concatenate(faces)),
        np.concatenate([solid.weights for solid in solids]),
        joints,
    )

"""Small figures that the proxy tests share."""

import igl
import numpy as np

from bunraku.types import Mesh


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Mesh:
    """Twelve triangles around a box, facing outwards."""
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])
    return Mesh(np.array(low) + corners * (np.array(high) - low), faces)


def together(*parts: Mesh) -> Mesh:
    """Put meshes into one, side by side."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts])
    return Mesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)]),
    )


def trestle() -> Mesh:
    """A beam on two legs 0.04 apart, as three boxes that overlap: 1 m tall."""
    beam = box((-0.5, 0.8, -0.1), (0.5, 1.0, 0.1))
    return together(
        beam,
        box((-0.22, 0.0, -0.1), (-0.02, 0.85, 0.1)),
        box((0.02, 0.0, -0.1), (0.22, 0.85, 0.1)),
    )


def genus(mesh: Mesh) -> int:
    return int(1 - igl.euler_characteristic(mesh.faces) / 2)

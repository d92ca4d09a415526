"""Follow the whole figure through a depth video, once it is known how the performer lies on it.

What a single view shows of a performer has no back, no far legs, and glues limbs that touch in the
frame it was taken from. The figure has all of that right. Brought into the performer's shape and
pose it is the better model to fit to every frame, by the same solver (docs/log.md).
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from bunraku.curves import CurveSkeleton
from bunraku.meshes import vertex_normals
from bunraku.registration.deformation import at_rest, warp
from bunraku.registration.rings import build_ring_graph
from bunraku.registration.tracking import (
    Model,
    Progress,
    Settings,
    Sight,
    are_seen,
    fit_frame,
    follow,
)
from bunraku.types import Mesh

Paths = Float[np.ndarray, "frames vertices 3"]
ASKED = 1500  # points of each side that an error is measured from
# ball joints hold; hidden limbs come back, but not to all that is unexplained, nor stick out
SETTINGS = Settings(rigidity=100.0, behind=True, outline=0.6, unexplained=0.15, reach=0.25)


def follow_whole(
    surface: Mesh,
    curves: CurveSkeleton,
    sight: Sight,
    frame: int,
    *,
    exact: bool = False,
    progress: Progress = lambda done, count: None,
) -> Paths:
    """Follow a closed surface through all frames from the one in which it lies about right.

    Args:
        surface: in the camera's frame, metres; closed.
        curves: its curve skeleton, which the solver's nodes lie on.
        frame: in which the surface lies about right.
        exact: it lies there as it should; else it is fitted to that frame first.
    """
    unit = sight.unit
    vertices, faces = surface.vertices / unit, surface.faces
    small = replace(curves, nodes=curves.nodes / unit)
    graph = build_ring_graph(vertices, faces, small, SETTINGS.radius)
    model = Model(vertices, vertex_normals(vertices, faces), graph, unit)
    view, camera = sight.views[frame], sight.intrinsics
    begin = at_rest(graph)
    if not exact:
        begin = fit_frame(model, begin, view, camera, SETTINGS, seed=frame)
    motions = follow(model, begin, sight, frame, settings=SETTINGS, progress=progress)
    return np.stack([unit * warp(graph, motion, vertices, slice(None)) for motion in motions])


def depth_errors(
    paths: Paths, faces: Int[np.ndarray, "faces 3"], sight: Sight
) -> Float[np.ndarray, " frames"]:
    """Measure how badly a moving surface explains each frame: distances both ways, metres.

    The mean distance from depth to the surface, and from what should be seen of it to the depth.
    """
    errors = []
    for places, view in zip(paths, sight.views, strict=True):
        normals = vertex_normals(places, faces)
        facing, shown = are_seen(places, normals, view, sight.intrinsics, slack=0.05 * sight.unit)
        asked = view.vertices[:: max(1, len(view.vertices) // ASKED)]
        missed = cKDTree(places).query(asked)[0].mean()
        seen = places[facing & shown]
        surplus = cKDTree(view.vertices).query(seen)[0].mean() if len(seen) else missed
        errors.append(float(missed + surplus))
    return np.array(errors)

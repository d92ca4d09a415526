"""Hold joints where a person clicked them, as pins between points that are no surface."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bunraku.meshes import scale_to_unit_area
from bunraku.registration.body import Body
from bunraku.registration.correspondence import Surface, pin
from bunraku.types import Mesh

HELD = 30.0  # pairs of points that one landmark outweighs


def hold_landmarks(
    body: Body,
    figure: Mesh,
    surface: Surface,
    landmarks: Mapping[str, Sequence[float]],
    names: Sequence[str],
) -> tuple[Body, Surface]:
    """Pin joints of the source to places on the figure, for the articulated fit.

    Args:
        body: the source.
        figure: the figure's proxy, in metres.
        surface: the same, prepared for fitting at area 1.
        landmarks: joint name to its place on the figure, metres in the figure's frame.
        names: of the source's joints.

    Returns:
        body and surface with one more point for each landmark, in no face, and pins between.

    Raises:
        ValueError: if a landmark names no joint.
    """
    for name in landmarks:
        if name not in names:
            known = ", ".join(names[:12])
            raise ValueError(f"landmark {name!r} is no joint of the performance; it has {known}")
    joints = np.array([list(names).index(name) for name in landmarks], np.int64)
    _, centre, scale = scale_to_unit_area(body.proxy.mesh.vertices, body.proxy.mesh.faces)
    _, goal_centre, goal_scale = scale_to_unit_area(figure.vertices, figure.faces)
    places = np.array(list(landmarks.values()), float).reshape(-1, 3)
    puppet = body.puppet
    weights = np.zeros((len(joints), len(puppet.joints)))
    weights[np.arange(len(joints)), puppet.owners[joints]] = 1.0
    moving = len(puppet.vertices) + np.arange(len(joints))
    still = len(surface.vertices) + np.arange(len(joints))
    nowhere = np.zeros((len(joints), 3))
    pinned = replace(
        puppet,
        vertices=np.concatenate([puppet.vertices, (body.joints[joints] - centre) / scale]),
        weights=np.concatenate([puppet.weights, weights]),
    )
    goal = replace(
        surface,
        vertices=np.concatenate([surface.vertices, (places - goal_centre) / goal_scale]),
        normals=np.concatenate([surface.normals, nowhere]),
        areas=np.concatenate([surface.areas, nowhere[:, 0]]),
        pins=pin(moving, still, HELD),
    )
    return replace(body, puppet=pinned), goal

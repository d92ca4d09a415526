"""A rigged character made ready to be registered: proxy, skin on it, puppet."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.meshes import (
    closest_points,
    interpolate,
    scale_to_unit_area,
    vertex_areas,
)
from bunraku.proxy import Proxy, build_proxy
from bunraku.registration.moments import Moments, look_at_clips
from bunraku.registration.puppet import Pose, Puppet, learn_stiffness, make_puppet, tree_of_places
from bunraku.skinning import forward_kinematics
from bunraku.types import Character


@dataclass(frozen=True, eq=False)
class Body:
    """A character's proxy with its skin, in the character's own metres, and as a puppet."""

    proxy: Proxy
    weights: Float[np.ndarray, "vertices joints"]  # of every joint, at the proxy's vertices
    areas: Float[np.ndarray, " vertices"]  # of the proxy's vertices
    joints: Float[np.ndarray, "joints 3"]  # at rest
    parents: Int[np.ndarray, " joints"]
    carriers: Int[np.ndarray, " joints"]  # whose motion carries each joint's place
    puppet: Puppet  # the same at area 1, centred, with the joints that move surface
    moments: Moments  # out of the clips

    @property
    def surface(
        self,
    ) -> tuple[
        Float[np.ndarray, "vertices 3"],
        Float[np.ndarray, " vertices"],
        Float[np.ndarray, "vertices joints"],
    ]:
        """Vertices, their areas and their skin."""
        return self.proxy.mesh.vertices, self.areas, self.weights


def wrap_character(source: Character) -> Body:
    """Wrap a character in a closed proxy that carries its skin.

    Raises:
        ValueError: if the character has no surface.
    """
    if not len(source.mesh.faces):
        raise ValueError("the performance has a skeleton but no surface to compare the figure with")
    proxy = build_proxy(source.mesh.vertices, source.mesh.faces)
    vertices, faces = proxy.mesh.vertices, proxy.mesh.faces
    face, shares, _ = closest_points(vertices, source.mesh.vertices, source.mesh.faces)
    weights = interpolate(source.skin.weights, source.mesh.faces[face], shares)
    joints = forward_kinematics(source.skeleton.parents, source.skeleton.rest)[:, :3, 3]
    unit, centre, scale = scale_to_unit_area(vertices, faces)
    parents = source.skeleton.parents
    areas = vertex_areas(vertices, faces)
    moments = look_at_clips(source, areas @ weights)
    puppet = make_puppet(unit, faces, weights, (joints - centre) / scale, parents)
    puppet = learn_stiffness(puppet, moments.turns[moments.unlike])
    carriers = tree_of_places(puppet, parents)
    return Body(proxy, weights, areas, joints, parents, carriers, puppet, moments)


def posed_turns(body: Body, pose: Pose) -> Float[np.ndarray, "joints 3 3"]:
    """Give the world turn of every joint of the full skeleton as a posed puppet carries it."""
    return pose.world(body.puppet)[0][body.puppet.owners]


def posed_joints(body: Body, pose: Pose) -> Float[np.ndarray, "joints 3"]:
    """Place every joint of the full skeleton as a posed puppet carries it, at area 1."""
    _, centre, scale = scale_to_unit_area(body.proxy.mesh.vertices, body.proxy.mesh.faces)
    _, linear, anchors = pose.world(body.puppet)
    by = body.puppet.owners
    offsets = (body.joints - centre) / scale - body.puppet.anchors[by]
    return anchors[by] + np.einsum("jab,jb->ja", linear[by], offsets)

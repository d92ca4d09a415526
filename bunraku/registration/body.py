"""A rigged character made ready to be registered: proxy, skin on it, puppet."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.graphs import ancestors
from bunraku.meshes import (
    closest_points,
    farthest_points,
    interpolate,
    scale_to_unit_area,
    vertex_areas,
)
from bunraku.proxy import Proxy, build_proxy
from bunraku.registration.puppet import Pose, Puppet, learn_stiffness, make_puppet, tree_of_places
from bunraku.rotations import decompose_transforms
from bunraku.skinning import clip_transforms, forward_kinematics
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
    moments: Float[np.ndarray, "moments joints 3 3"]  # world turns since rest, out of the clips

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
    moments = choose_moments(source, areas @ weights)
    puppet = make_puppet(unit, faces, weights, (joints - centre) / scale, parents)
    puppet = learn_stiffness(puppet, moments)
    carriers = tree_of_places(puppet, parents)
    return Body(proxy, weights, areas, joints, parents, carriers, puppet, moments)


def choose_moments(
    source: Character, mass: Float[np.ndarray, " joints"], *, count: int = 24, each: int = 8
) -> Float[np.ndarray, "moments joints 3 3"]:
    """Choose unlike moments of a character's clips: world turns of its joints since rest.

    Args:
        mass: how much surface each joint moves.
        count: moments to give at most.
        each: moments looked at in each clip.
    """
    if not source.clips:
        return np.empty((0, len(mass), 3, 3))
    rest = forward_kinematics(source.skeleton.parents, source.skeleton.rest)[:, :3, :3]
    looked = []
    for clip in source.clips:
        frames = np.unique(np.linspace(0, len(clip.times) - 1, each).astype(int))
        local = clip_transforms(clip, frames)
        _, world, _ = decompose_transforms(forward_kinematics(source.skeleton.parents, local))
        looked.append(world @ np.swapaxes(rest, 1, 2))
    turns = np.concatenate(looked)
    spread = (turns * np.sqrt(mass / mass.sum())[:, None, None]).reshape(len(turns), -1)
    return turns[farthest_points(spread, count)]


def moving_joint(body: Body, joint: int) -> int:
    """Give the puppet's joint that carries a joint of the full skeleton."""
    place = {int(kept): index for index, kept in enumerate(body.puppet.joints)}
    return next((place[above] for above in ancestors(body.parents, joint) if above in place), 0)


def posed_turns(body: Body, pose: Pose) -> Float[np.ndarray, "joints 3 3"]:
    """Give the world turn of every joint of the full skeleton as a posed puppet carries it."""
    by = [moving_joint(body, joint) for joint in range(len(body.joints))]
    return pose.world(body.puppet)[0][by]


def posed_joints(body: Body, pose: Pose) -> Float[np.ndarray, "joints 3"]:
    """Place every joint of the full skeleton as a posed puppet carries it, at area 1."""
    _, centre, scale = scale_to_unit_area(body.proxy.mesh.vertices, body.proxy.mesh.faces)
    _, linear, anchors = pose.world(body.puppet)
    by = np.array([moving_joint(body, joint) for joint in range(len(body.joints))])
    offsets = (body.joints - centre) / scale - body.puppet.anchors[by]
    return anchors[by] + np.einsum("jab,jb->ja", linear[by], offsets)

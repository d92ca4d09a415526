"""Put right what a rig got wrong: a joint moves to another place, skin and clips go with it."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from bunraku.skinning import forward_kinematics, local_transforms
from bunraku.types import NO_PARENT, Character, Skeleton, Skin
from bunraku.weights import transfer_to_surface


def move_joint(character: Character, joint: int, place: Float[np.ndarray, "3"]) -> Character:
    """Give a character the same joint in another place; all others stay where they are.

    Weights follow the joint along its bones: what lay about the old place comes to lie about the
    new one, and nothing changes at the neighbouring joints. Clips keep their turns; bones beside
    the joint get their new lengths in every frame.

    Args:
        character: as it was bound; its surface does not change.
        joint: which one.
        place: where it belongs, in metres, in the pose in which the skin was bound.
    """
    skeleton, skin = character.skeleton, character.skin
    bound = np.linalg.inv(skin.inverse_bind)
    shift = np.asarray(place, np.float64) - bound[joint, :3, 3]
    moved = bound.copy()
    moved[joint, :3, 3] += shift
    world = forward_kinematics(skeleton.parents, skeleton.rest)
    world[joint, :3, 3] += shift
    rest = local_transforms(skeleton.parents, world)
    lengths = rest[:, :3, 3] - skeleton.rest[:, :3, 3]
    return Character(
        character.mesh,
        replace(skeleton, rest=rest),
        Skin(_move_weights(character, joint, moved[:, :3, 3], shift), np.linalg.inv(moved)),
        tuple(replace(clip, translations=clip.translations + lengths) for clip in character.clips),
    )


def _move_weights(
    character: Character,
    joint: int,
    places: Float[np.ndarray, "joints 3"],
    shift: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "vertices joints"]:
    """Let each vertex have the weights of the point from which the joint's move carries it here."""
    mesh, weights = character.mesh, character.skin.weights
    carried = _reach(mesh.vertices, places, character.skeleton, joint)
    parent = character.skeleton.parents[joint]
    share = weights[:, joint] + (weights[:, parent] if parent != NO_PARENT else 0.0)
    carried *= np.minimum(share, 1.0)
    near = np.flatnonzero(carried > 0)
    if not len(near):
        return weights
    origins = mesh.vertices[near] - carried[near, None] * shift
    found = weights.copy()
    if len(mesh.faces):
        found[near] = transfer_to_surface(weights, mesh.vertices, mesh.faces, origins)
    else:
        found[near] = weights[KDTree(mesh.vertices).query(origins)[1]]
    return found


def _reach(
    vertices: Float[np.ndarray, "vertices 3"],
    places: Float[np.ndarray, "joints 3"],
    skeleton: Skeleton,
    joint: int,
) -> Float[np.ndarray, " vertices"]:
    """Tell how far each vertex goes with a joint: 1 beside it, 0 beside its neighbours.

    It falls evenly along the nearest of the joint's bones; beyond a last joint it stays 1.
    """
    above, here = int(skeleton.parents[joint]), places[joint]
    ends = ([above] if above != NO_PARENT else []) + np.flatnonzero(
        skeleton.parents == joint
    ).tolist()
    nearest, reach = np.full(len(vertices), np.inf), np.ones(len(vertices))
    for end in ends:
        bone = places[end] - here
        along = (vertices - here) @ bone / max(float(bone @ bone), 1e-12)
        along = np.clip(along, 0.0, 1.0)
        distance = np.linalg.norm(vertices - here - along[:, None] * bone, axis=1)
        reach = np.where(distance < nearest, 1.0 - along, reach)
        nearest = np.minimum(nearest, distance)
    return reach

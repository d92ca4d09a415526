"""Play a clip on a figure: the source's world turns on the figure's own bones.

[IE] Musoni et al. 2021, Sec. 5.3: with equal rest poses the rotations are copied unchanged. The
figure's joint frames at rest are the source's, so a copied world frame carries twist as well.
Translations that a clip moves (the root, squash and stretch, IK feet) are scaled to the figure.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from bunraku.graphs import root_first
from bunraku.meshes import referenced
from bunraku.registration.body import Body
from bunraku.reposing import Reposed
from bunraku.rotations import (
    compose_transforms,
    decompose_transforms,
    invert_rigid,
    matrices_to_quaternions,
)
from bunraku.skinning import (
    clip_transforms,
    forward_kinematics,
    linear_blend_skinning,
    local_transforms,
)
from bunraku.types import NO_PARENT, Clip, Mesh, Skeleton

LEAST_SCALE = 1e-3  # what a clip scales to nothing, to hide it, stays just larger than nothing


@dataclass(frozen=True, eq=False)
class Retarget:
    """What carries clips of a source skeleton to a figure: both at rest, and who carries whom."""

    source: Skeleton
    places: Float[np.ndarray, "joints 3"]  # the figure's joints in the source's rest pose
    carriers: Int[np.ndarray, " joints"]  # whose motion carries each joint's place
    scale: float  # figure to source, of the way the root travels
    heading: Float[np.ndarray, "3 3"]  # turn about the vertical from the source's front


def turned_frames(
    source: Skeleton,
    places: Float[np.ndarray, "joints 3"],
    turns: Float[np.ndarray, "joints 3 3"] | None = None,
) -> Float[np.ndarray, "joints 4 4"]:
    """Give world_from_joint at these places: the source's rest frames, turned if need be."""
    world = forward_kinematics(source.parents, source.rest)[:, :3, :3]
    return compose_transforms(places, world if turns is None else turns @ world)


def skeleton_of(source: Skeleton, world: Float[np.ndarray, "joints 4 4"]) -> Skeleton:
    """Give the source's joints, with its names and tree, in other world frames."""
    return Skeleton(source.names, source.parents, local_transforms(source.parents, world))


def plan_retarget(
    body: Body,
    reposed: Reposed,
    figure: Mesh,
    weights: Float[np.ndarray, "vertices joints"],
    source: Skeleton,
) -> Retarget:
    """Stand the reposed figure where it belongs; scale travel by the height of the hips.

    Args:
        body: the source, wrapped.
        reposed: the figure's way to the source's rest pose.
        figure: as found; its vertices in no face, which nobody sees, do not count.
        weights: its skin.
        source: the source's skeleton.
    """
    plan = Retarget(source, reposed.places, body.carriers, 1.0, reposed.heading)
    bind = turned_frames(source, reposed.found, reposed.heading @ reposed.turns)
    rest = heading_frames(plan)
    seen = referenced(figure.faces, len(weights)) if len(figure.faces) else slice(None)
    found = figure.vertices[seen]
    rested = linear_blend_skinning(found, weights[seen], rest @ invert_rigid(bind))
    hips, ground = body.puppet.joints[0], float(rested[:, 1].min())
    own = float(body.joints[hips, 1] - body.proxy.mesh.vertices[:, 1].min())
    height = float(rest[hips, 1, 3]) - ground
    scale = height / own if min(own, height) > 1e-6 else 1.0
    home = reposed.heading @ (scale * body.joints[hips])
    aside = home - rest[hips, :3, 3] if reposed.trunk > 0.5 else np.zeros(3)
    shift = way_home(found, rested, aside, posed=reposed.posed > 0.5)
    return replace(plan, places=reposed.places + shift, scale=scale)


def plan_embedded(
    source: Skeleton,
    joints: Float[np.ndarray, "joints 3"],
    turns: Float[np.ndarray, "joints 3 3"],
    heading: Float[np.ndarray, "3 3"],
    scale: float,
) -> Retarget:
    """Plan for a figure that a skeleton was embedded in: its bones turn back to the source's rest.

    Args:
        source: the performer's skeleton.
        joints: their places in the figure as found.
        turns: of each joint from the source's rest to the figure, before the heading.
        heading: turn of the performer as a whole.
        scale: figure to performer.
    """
    places = joints.copy()
    for joint, parent in enumerate(source.parents):
        if parent != NO_PARENT:
            bone = joints[joint] - joints[parent]
            places[joint] = places[parent] + turns[parent].T @ heading.T @ bone
    return Retarget(source, places, source.parents, scale, heading)


def way_home(
    found: Float[np.ndarray, "vertices 3"],
    rested: Float[np.ndarray, "vertices 3"],
    aside: Float[np.ndarray, "3"],
    *,
    posed: bool,
) -> Float[np.ndarray, "3"]:
    """Say how to move a reposed figure so that it stands where clips expect it.

    A figure found at rest stays on its own ground. One caught in motion, near the origin of its
    file, perhaps in the air, goes to the floor y = 0 and, if it is like the source, over the
    origin, as the source stands at rest.

    Args:
        found: the figure's vertices as found.
        rested: the same in the source's rest pose.
        aside: way along the ground to where the source stands; zero if that is not known.
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


def heading_frames(retarget: Retarget) -> Float[np.ndarray, "joints 4 4"]:
    """Give world_from_joint of the figure at rest, facing its own front."""
    return face_heading(retarget) @ turned_frames(retarget.source, retarget.places)


def face_heading(retarget: Retarget) -> Float[np.ndarray, "4 4"]:
    """Turn the world from the source's front to the figure's, about the figure's root."""
    about = retarget.places[root_first(retarget.carriers)[0]]
    return compose_transforms(about - retarget.heading @ about, retarget.heading)


def retarget_clip(clip: Clip, retarget: Retarget) -> Clip:
    """Carry one clip to the figure: rotations copied in the world, places rebuilt bone by bone.

    Returns:
        the clip of the same name and times, parent_from_joint on the figure's skeleton.
    """
    source = retarget.source
    moving = forward_kinematics(source.parents, clip_transforms(without_nothing(clip)))
    at_rest = forward_kinematics(source.parents, source.rest)
    figure = turned_frames(source, retarget.places)
    placed = moving.copy()
    for joint in root_first(retarget.carriers):
        carrier = int(retarget.carriers[joint])
        if carrier == NO_PARENT:
            travelled = moving[:, joint, :3, 3] - at_rest[joint, :3, 3]
            placed[:, joint, :3, 3] = figure[joint, :3, 3] + retarget.scale * travelled
            continue
        offset = place_in_frame(at_rest[carrier], at_rest[joint])
        own = place_in_frame(figure[carrier], figure[joint])
        carried = np.linalg.solve(moving[:, carrier], moving[:, joint])[:, :3, 3]
        local = own + length_ratio(own, offset, retarget.scale) * (carried - offset)
        turned = np.einsum("fab,fb->fa", placed[:, carrier, :3, :3], local)
        placed[:, joint, :3, 3] = placed[:, carrier, :3, 3] + turned
    return as_clip(clip, local_transforms(source.parents, face_heading(retarget) @ placed))


def without_nothing(clip: Clip) -> Clip:
    """Keep scales away from zero, where places below a joint cannot be told any more."""
    least = np.copysign(LEAST_SCALE, clip.scales)
    return replace(clip, scales=np.where(np.abs(clip.scales) < LEAST_SCALE, least, clip.scales))


def place_in_frame(
    world_from_carrier: Float[np.ndarray, "4 4"], world_from_joint: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "3"]:
    """Give a joint's place in its carrier's frame."""
    return (invert_rigid(world_from_carrier) @ world_from_joint)[:3, 3]


def length_ratio(
    own: Float[np.ndarray, "3"], offset: Float[np.ndarray, "3"], otherwise: float
) -> float:
    """Compare two bones' lengths; a bone without length takes the whole figure's ratio."""
    length = float(np.linalg.norm(offset))
    if length < 1e-4:
        return otherwise
    return float(np.clip(np.linalg.norm(own) / length, 0.25 * otherwise, 4.0 * otherwise))


def start_above(clip: Clip, place: Float[np.ndarray, "3"]) -> Clip:
    """Move a clip along the ground so that its root starts above or below a place."""
    aside = (place - clip.translations[0, 0]) * [1.0, 0.0, 1.0]
    translations = clip.translations.copy()
    translations[:, 0] += aside
    return replace(clip, translations=translations)


def as_clip(clip: Clip, local: Float[np.ndarray, "frames joints 4 4"]) -> Clip:
    """Put local transforms back into a clip's parts, neighbouring quaternions on one side."""
    translations, rotations, scales = decompose_transforms(local)
    quaternions = matrices_to_quaternions(rotations)
    same = np.einsum("fjc,fjc->fj", quaternions[1:], quaternions[:-1]) >= 0
    quaternions[1:] *= np.cumprod(np.where(same, 1.0, -1.0), axis=0)[:, :, None]
    return Clip(clip.name, clip.times, translations, quaternions, scales)

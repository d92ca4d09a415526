"""Play a clip on a figure: the source's world turns on the figure's own bones.

[IE] Musoni et al. 2021, Sec. 5.3: with equal rest poses the rotations are copied unchanged. The
figure's joint frames at rest are the source's, so a copied world frame carries twist as well.
Translations that a clip moves (the root, squash and stretch, IK feet) are scaled to the figure.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku.contacts import (
    Arm,
    Dressed,
    Leg,
    Performed,
    choose_moments,
    choose_swing,
    find_arms,
    find_legs,
    plant_feet,
    swing_arm,
)
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

logger = logging.getLogger(__name__)
LEAST_TRAVEL = 0.25  # of the ratio of heights: legs shorter than that are a joint gone astray
LEAST_SCALE = 1e-3  # what a clip scales to nothing, to hide it, stays just larger than nothing


@dataclass(frozen=True, eq=False)
class Retarget:
    """What carries clips of a source skeleton to a figure: both at rest, and who carries whom."""

    source: Skeleton
    places: Float[np.ndarray, "joints 3"]  # the figure's joints in the source's rest pose
    carriers: Int[np.ndarray, " joints"]  # whose motion carries each joint's place
    scale: float  # figure to source, of the way the root travels
    heading: Float[np.ndarray, "3 3"]  # turn about the vertical from the source's front
    legs: tuple[Leg, ...] = ()  # whose contacts with the ground are kept
    height: float = 1.0  # of the source at rest, in metres
    swings: tuple[tuple[Arm, float], ...] = ()  # of arms, that keep hands out of the body


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
    legs = find_legs(body.proxy.mesh.vertices, body.weights, body.joints, body.carriers)
    tall = float(np.ptp(body.proxy.mesh.vertices[:, 1]))
    plan = Retarget(source, reposed.places, body.carriers, 1.0, reposed.heading, legs, tall)
    bind = turned_frames(source, reposed.found, reposed.heading @ reposed.turns)
    rest = heading_frames(plan)
    seen = referenced(figure.faces, len(weights)) if len(figure.faces) else slice(None)
    found = figure.vertices[seen]
    rested = linear_blend_skinning(found, weights[seen], rest @ invert_rigid(bind))
    hips = body.puppet.joints[0]
    scale = travel_scale(
        (float(body.joints[hips, 1]), float(rest[hips, 1, 3])),
        (body.proxy.mesh.vertices[:, 1], rested[:, 1]),
    )
    home = reposed.heading @ (scale * body.joints[hips])
    aside = home - rest[hips, :3, 3] if reposed.trunk > 0.5 else np.zeros(3)
    shift = way_home(found, rested, aside, posed=reposed.posed > 0.5)
    return replace(plan, places=reposed.places + shift, scale=scale)


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
        logger.warning(
            "no body of this height has its hips where they were found; travel is a guess"
        )
    return scale


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


def carry_clips(
    clips: Sequence[Clip], retarget: Retarget, performer: Dressed, surface: Dressed
) -> tuple[Retarget, tuple[Clip, ...]]:
    """Carry clips to the figure, its arms swung where they would go into its body.

    Args:
        clips: of the source.
        retarget: the plan, without swings.
        performer: the source's proxy, at rest.
        surface: the figure's, in the pose it was found in.

    Returns:
        the plan with its swings, and the clips.
    """
    plan, arms = retarget, arms_of(retarget) if clips else ()
    if arms:
        source = retarget.source
        rest, bodies = turned_frames(source, retarget.places), (surface, performer)
        looked = choose_moments([len(clip.times) for clip in clips]).items()
        ours = np.concatenate([carry_frames(clips[k], retarget)[frames] for k, frames in looked])
        theirs = np.concatenate([source_frames(clips[k], source)[frames] for k, frames in looked])
        angles = [choose_swing(ours, rest, arm, bodies, theirs) for arm in arms]
        plan = replace(plan, swings=tuple(zip(arms, angles, strict=True)) if any(angles) else ())
    return plan, tuple(retarget_clip(clip, plan) for clip in clips)


def arms_of(retarget: Retarget) -> tuple[Arm, ...]:
    """Find the arms of the source, if its joints are named as such."""
    names, carriers = retarget.source.names, retarget.carriers
    return find_arms(names, retarget.places, carriers, retarget.legs)


def dress_source(body: Body, source: Skeleton) -> Dressed:
    """Give the source's proxy its skin."""
    at_rest = forward_kinematics(source.parents, source.rest)
    return Dressed(body.proxy.mesh, body.weights, at_rest)


def dress(
    mesh: Mesh,
    figure: Mesh,
    weights: Float[np.ndarray, "vertices joints"],
    bind: Float[np.ndarray, "joints 4 4"],
) -> Dressed:
    """Give a proxy the skin of the figure's vertices nearest to it."""
    nearest = KDTree(figure.vertices).query(mesh.vertices)[1]
    return Dressed(mesh, weights[nearest], bind)


def retarget_clip(clip: Clip, retarget: Retarget) -> Clip:
    """Carry one clip to the figure: rotations copied in the world, places rebuilt bone by bone.

    Returns:
        the clip of the same name and times, parent_from_joint on the figure's skeleton.
    """
    frames = carry_frames(clip, retarget)
    rest = turned_frames(retarget.source, retarget.places)
    for arm, angle in retarget.swings:
        frames = swing_arm(frames, rest, arm, angle)
    world = face_heading(retarget) @ frames
    return as_clip(clip, local_transforms(retarget.source.parents, world))


def carry_frames(clip: Clip, retarget: Retarget) -> Float[np.ndarray, "frames joints 4 4"]:
    """Give world_from_joint of the figure in a clip, facing the source's front."""
    source = retarget.source
    moving = source_frames(clip, source)
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
    performed = Performed(moving[..., :3, 3], at_rest[:, :3, 3], clip.times, retarget.height)
    return plant_feet(placed, figure[:, :3, 3], retarget.legs, performed, scale=retarget.scale)


def source_frames(clip: Clip, source: Skeleton) -> Float[np.ndarray, "frames joints 4 4"]:
    """Give world_from_joint of the source in a clip."""
    return forward_kinematics(source.parents, clip_transforms(without_nothing(clip)))


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


def as_clip(clip: Clip, local: Float[np.ndarray, "frames joints 4 4"]) -> Clip:
    """Put local transforms back into a clip's parts, neighbouring quaternions on one side."""
    translations, rotations, scales = decompose_transforms(local)
    quaternions = matrices_to_quaternions(rotations)
    same = np.einsum("fjc,fjc->fj", quaternions[1:], quaternions[:-1]) >= 0
    quaternions[1:] *= np.cumprod(np.where(same, 1.0, -1.0), axis=0)[:, :, None]
    return Clip(clip.name, clip.times, translations, quaternions, scales)

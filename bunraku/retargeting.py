"""Play a clip on a figure: the source's world turns on the figure's own bones.

[IE] Musoni et al. 2021, Sec. 5.3: with equal rest poses the rotations are copied unchanged. The
figure's joint frames at rest are the source's, so a copied world frame carries twist as well.
Translations that a clip moves (the root, squash and stretch, IK feet) are scaled to the figure.
"""

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
from bunraku.graphs import ancestors, root_first
from bunraku.meshes import referenced, vertex_areas
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
from bunraku.standing import ground_under, travel_scale, way_aside, way_home
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
) -> tuple[Retarget, Reposed]:
    """Stand the reposed figure where it belongs; scale travel by the height of the hips.

    Args:
        body: the source, wrapped.
        reposed: the figure's way to the source's rest pose.
        figure: as found; its vertices in no face, which nobody sees, do not count.
        weights: its skin.
        source: the source's skeleton.

    Returns:
        the plan, and the figure's way with the joints on the floor set right.
    """
    legs = find_legs(body.proxy.mesh.vertices, body.weights, body.joints, body.carriers)
    tall = float(np.ptp(body.proxy.mesh.vertices[:, 1]))
    plan = Retarget(source, reposed.places, body.carriers, 1.0, reposed.heading, legs, tall)
    bind = turned_frames(source, reposed.found, reposed.heading @ reposed.turns)
    rest = heading_frames(plan)
    seen = referenced(figure.faces, len(weights)) if len(figure.faces) else slice(None)
    found = figure.vertices[seen]
    rested = linear_blend_skinning(found, weights[seen], rest @ invert_rigid(bind))
    posed = reposed.posed > 0.5
    if posed:  # what reaches below the ground is a limb wrongly straightened
        rested[:, 1] = rested[:, 1].clip(min=ground_under(rested, weights[seen], body))
    hips = body.puppet.joints[0]
    scale = travel_scale(
        (float(body.joints[hips, 1]), float(rest[hips, 1, 3])),
        (body.proxy.mesh.vertices[:, 1], rested[:, 1]),
    )
    areas = vertex_areas(figure.vertices, figure.faces)[seen]  # points have none
    middle = np.average(rested, axis=0, weights=areas if areas.any() else None)
    places = rest[hips, :3, 3], middle
    alike = reposed.trunk > 0.5
    aside = way_aside(body, reposed.heading, *places, scale=scale, alike=alike)
    shift = way_home(found, rested, aside, posed=posed)
    stood = replace(plan, places=reposed.places + shift, scale=scale)
    return stand_floor_joints(body, reposed, stood)


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


def stand_floor_joints(body: Body, reposed: Reposed, plan: Retarget) -> tuple[Retarget, Reposed]:
    """Put the joints above the hips, which move next to no surface, where the source has them.

    A rig's origin on the floor is what a body turns about when it falls: beside the hips, at the
    scale of the hips' height, it lies on the figure's floor as well.

    Returns:
        the same with these joints moved, at rest and as found.
    """
    hips = int(body.puppet.joints[0])
    floor = np.array(ancestors(plan.carriers, hips)[1:], np.int64)
    if not len(floor):
        return plan, reposed
    beside = plan.scale * (body.joints[floor] - body.joints[hips])
    places, found = plan.places.copy(), reposed.found.copy()
    places[floor] = places[hips] + beside
    found[floor] = found[hips] + beside @ (plan.heading @ reposed.turns[hips]).T
    root = root_first(plan.carriers)[0]
    moved = places[root] - plan.places[root]  # the figure is faced about its root: stay there
    stood = replace(plan, places=places + plan.heading @ moved - moved)
    return stood, replace(reposed, found=found)


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

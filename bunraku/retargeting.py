"""Play a clip on a figure: the source's world turns on the figure's own bones.

[IE] Musoni et al. 2021, Sec. 5.3: with equal rest poses the rotations are copied unchanged. The
figure's joint frames at rest are the source's, so a copied world frame carries twist as well.
Translations that a clip moves (the root, squash and stretch, IK feet) are scaled to the figure.
"""

import logging
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from bunraku.contacts import Leg, Performed, find_legs, plant_feet
from bunraku.graphs import ancestors, descendants, root_first
from bunraku.meshes import referenced
from bunraku.registration.body import Body
from bunraku.reposing import Reposed
from bunraku.reposing.decision import is_stood_on, limbs
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
    posed = reposed.posed > 0.5
    if posed:  # what reaches below the ground is a limb wrongly straightened
        rested[:, 1] = rested[:, 1].clip(min=ground_under(rested, weights[seen], body))
    hips = body.puppet.joints[0]
    scale = travel_scale(
        (float(body.joints[hips, 1]), float(rest[hips, 1, 3])),
        (body.proxy.mesh.vertices[:, 1], rested[:, 1]),
    )
    home = reposed.heading @ (scale * body.joints[hips])
    aside = home - rest[hips, :3, 3] if reposed.trunk > 0.5 else np.zeros(3)
    shift = way_home(found, rested, aside, posed=posed)
    return replace(plan, places=reposed.places + shift, scale=scale)


def ground_under(
    rested: Float[np.ndarray, "vertices 3"],
    weights: Float[np.ndarray, "vertices joints"],
    body: Body,
) -> float:
    """Find the ground a figure stands on: its lowest point, or that of its lowest limb but one.

    Of three limbs or more that a body stands on one may have been put wrongly, and hang down.

    Args:
        rested: the figure's vertices in the source's rest pose.
        weights: its skin.
        body: the source.
    """
    below = descendants(body.carriers)
    stood_on = [below[limb] for limb in limbs(body).tolist() if is_stood_on(body, limb)]
    own = [weights[:, limb].sum(axis=1) > 0.5 for limb in stood_on]
    lows = sorted(float(rested[limb, 1].min()) for limb in own if limb.any())
    return lows[1] if len(lows) > 2 else float(rested[:, 1].min())


def stand_floor_joints(body: Body, reposed: Reposed, plan: Retarget) -> tuple[Reposed, Retarget]:
    """Put the joints above the hips, which move next to no surface, where the source has them.

    A rig's origin on the floor is what a body turns about when it falls: beside the hips, at the
    scale of the hips' height, it lies on the figure's floor as well.

    Returns:
        the same with these joints moved, as found and at rest.
    """
    hips = int(body.puppet.joints[0])
    floor = np.array(ancestors(plan.carriers, hips)[1:], np.int64)
    if not len(floor):
        return reposed, plan
    beside = plan.scale * (body.joints[floor] - body.joints[hips])
    places, found = plan.places.copy(), reposed.found.copy()
    places[floor] = places[hips] + beside
    found[floor] = found[hips] + beside @ (plan.heading @ reposed.turns[hips]).T
    root = root_first(plan.carriers)[0]
    moved = places[root] - plan.places[root]  # the figure is faced about its root: stay there
    stood = replace(plan, places=places + plan.heading @ moved - moved)
    return replace(reposed, found=found), stood


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
        logger.warning("the figure's hips were found outside its body; its travel is a guess")
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
    performed = Performed(moving[..., :3, 3], at_rest[:, :3, 3], clip.times, retarget.height)
    planted = plant_feet(placed, figure[:, :3, 3], retarget.legs, performed, scale=retarget.scale)
    return as_clip(clip, local_transforms(source.parents, face_heading(retarget) @ planted))


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

"""Move one human skeleton by the motion of another that has other bones and another rest pose.

For every joint the turn since rest, in the world, is carried over, after the rest poses are made
to agree. With W for world rotations, s and t for source and target,

    W_t(frame) = W_s(frame) W_s(rest)^-1 C W_t(rest)

where C (`alignment`) turns the target's bone, at rest, into the direction of the source's. The
trunk has one C, from hips and shoulders: where a rig puts its spine joints says nothing about
posture.
"""

import numpy as np
from jaxtyping import Float

from bunraku.humanoids.alignment import align_rests
from bunraku.humanoids.body import Body, read_body
from bunraku.humanoids.naming import SIDES, UP
from bunraku.rotations import (
    matrices_to_quaternions,
    matrices_to_vectors,
    nearest_rotation,
    vectors_to_matrices,
)
from bunraku.skinning import clip_transforms, forward_kinematics, local_transforms
from bunraku.types import NO_PARENT, Clip, Skeleton

ON_THE_FLOOR = 5.0  # percentile over frames of the lowest foot's height that counts as standing


def transfer_motion(skeleton: Skeleton, clip: Clip, onto: Skeleton) -> Clip:
    """Retarget a clip from one human skeleton onto another.

    Headings stay as they are in the clip, but for whole quarter turns if the skeletons face
    different axes at rest. The way of the hips is scaled by the length of the legs; the clip
    starts over the target's place, and its feet come down to the floor on which the target stands
    at rest. Joints without a counterpart stay at rest on their parents; spines with different
    numbers of joints share the bend.

    Raises:
        MatchError: if one of the skeletons is not a human's.
    """
    moved = forward_kinematics(skeleton.parents, clip_transforms(clip))
    source, target = read_body(skeleton, moved), read_body(onto)
    turn = _quarter_turns(source, target)
    turns = turn @ _turns(source, moved)
    driven = _drive(source, target, turns)
    hips_way = moved[:, source.named["hips"], :3, 3] @ turn.T
    hips_way *= target.leg_length / source.leg_length
    world = _pose(onto, target, driven, hips_way)
    _put_on_floor(target, world)
    local = local_transforms(onto.parents, world)
    scales = np.broadcast_to(np.linalg.norm(onto.rest[:, :3, :3], axis=1), (*local.shape[:2], 3))
    rotations = matrices_to_quaternions(local[..., :3, :3] / scales[..., None, :])
    return Clip(clip.name, clip.times, local[..., :3, 3].copy(), rotations, scales.copy())


def _turns(
    source: Body, moved: Float[np.ndarray, "frames joints 4 4"]
) -> Float[np.ndarray, "frames joints 3 3"]:
    """Find the turn of each joint since the reference pose, in the world, for those that count."""
    counting = sorted({*source.named.values(), *source.trunk, *source.neck})
    turns = np.broadcast_to(np.eye(3), (*moved.shape[:2], 3, 3)).copy()
    before = nearest_rotation(source.reference[counting, :3, :3])
    turns[:, counting] = nearest_rotation(moved[:, counting, :3, :3]) @ np.swapaxes(before, -1, -2)
    return turns


def _quarter_turns(source: Body, target: Body) -> Float[np.ndarray, "3 3"]:
    """Find the turn about up, in quarters, from the source's facing at rest to the target's."""
    if not source.stands_at_rest:
        return np.eye(3)
    wanted, given = target.frame[:, 2], source.frame[:, 2]
    angle = np.arctan2(np.cross(given, wanted) @ UP, given @ wanted - given @ UP * (wanted @ UP))
    return vectors_to_matrices(UP * np.round(angle / (np.pi / 2)) * (np.pi / 2))


def _drive(
    source: Body, target: Body, turns: Float[np.ndarray, "frames joints 3 3"]
) -> dict[int, Float[np.ndarray, "frames 3 3"]]:
    """Find the turn since rest, in the world, of every joint of the target that is driven."""
    aligned = align_rests(source, target, turns)
    trunk = aligned.pop("trunk")
    driven = {target.named[bone]: turns[:, source.named[bone]] @ c for bone, c in aligned.items()}
    shared = share_along(turns[:, source.trunk], len(target.trunk))
    driven |= {joint: shared[:, i] @ trunk for i, joint in enumerate(target.trunk)}
    if source.neck and target.neck:
        top = source.trunk[-1]
        shared = share_along(turns[:, [top, *source.neck]], len(target.neck) + 1)[:, 1:]
        driven |= {joint: shared[:, i] @ trunk for i, joint in enumerate(target.neck)}
    return driven


def share_along(
    turns: Float[np.ndarray, "frames links 3 3"], count: int
) -> Float[np.ndarray, "frames count 3 3"]:
    """Spread the turns of a chain of joints over a chain of another number of joints.

    First and last keep theirs; those between are interpolated on the sphere.
    """
    places = np.linspace(0.0, turns.shape[1] - 1, count) if count > 1 else np.zeros(1)
    before = np.minimum(places.astype(int), max(turns.shape[1] - 2, 0))
    after = np.minimum(before + 1, turns.shape[1] - 1)
    steps = np.swapaxes(turns[:, before], -1, -2) @ turns[:, after]
    partly = vectors_to_matrices(matrices_to_vectors(steps) * (places - before)[:, None])
    return turns[:, before] @ partly


def _pose(
    onto: Skeleton,
    target: Body,
    driven: dict[int, Float[np.ndarray, "frames 3 3"]],
    hips_way: Float[np.ndarray, "frames 3"],
) -> Float[np.ndarray, "frames joints 4 4"]:
    """Walk down the target: driven joints turn as told, all keep their place on their parent."""
    world = np.tile(target.reference, (len(hips_way), 1, 1, 1))
    hips = target.named["hips"]
    for joint, parent in enumerate(onto.parents):
        if parent != NO_PARENT:
            world[:, joint] = world[:, parent] @ onto.rest[joint]
        if joint in driven:
            world[:, joint, :3, :3] = driven[joint] @ target.reference[joint, :3, :3]
        if joint == hips:
            start = hips_way[0] * [1.0, 0.0, 1.0]
            world[:, joint, :3, 3] = (
                hips_way - start + target.reference[joint, :3, 3] * [1.0, 0.0, 1.0]
            )
    return world


def _put_on_floor(target: Body, world: Float[np.ndarray, "frames joints 4 4"]) -> None:
    """Lift or lower the whole clip, so that its feet stand as high as they do at rest."""
    feet = [
        target.named[f"{side}{bone}"]
        for side in SIDES
        for bone in ("Foot", "Toes")
        if f"{side}{bone}" in target.named
    ]
    clearance = (world[:, feet, 1, 3] - target.reference[feet, 1, 3]).min(axis=1)
    hips = target.named["hips"]
    moving = [hips, *target.tree.below(hips)]
    world[:, moving, 1, 3] -= np.percentile(clearance, ON_THE_FLOOR)

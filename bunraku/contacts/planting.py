"""Put planted feet where they belong on a figure: one smooth correction a leg, met by bending it.

The world turns of a clip, copied to other bones, let feet slide and float. During a contact a
figure's sole should go the way the source's goes, at the figure's scale: not at all, or backwards
on a treadmill. The ankle's correction d(t) follows from all contacts of its soles at once:

    min  sum_contacts int |p(t) + d(t) - s q(t) - c|^2 dt + eps int |d|^2 + tau^4 |d''|^2 dt

with p the sole as copied, q the source's, s the scale and one free anchor c for each contact
along the ground; its height is that of the figure's own rest pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import block_array, coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from bunraku.contacts.finding import Contacts, find_contacts
from bunraku.contacts.legs import Leg
from bunraku.contacts.limbs import bend_limb, bending_axes
from bunraku.rotations import compose_transforms

SMOOTH = 0.1  # seconds: tau, how long a correction takes to fade in and out
FADING = 1e-4  # eps: weight of not correcting against meeting a contact
FARTHEST = 0.35  # of a leg's length: corrections beyond are none of feet
HEAVY = 30.0  # a turn of a knee in radians, squared, against the hips' way in leg lengths, squared
STRAIGHT = 0.05  # sine of half a bend that counts as straight
DEEPEST = 0.15  # of a leg's length: how far hips may rise or sink
LEAST_LEG = 1e-5  # of the figure's height: no part of a leg that bends is shorter
UNDER = 0.4  # of its drop at rest: a leg that drops less lies or sits, and stands on nothing
CLOSED = 0.01  # heights: how near the last frame is to the first in a clip that loops

Frames = Float[np.ndarray, "frames joints 4 4"]
Paths = Float[np.ndarray, "frames joints 3"]
Places = Float[np.ndarray, "joints 3"]


@dataclass(frozen=True, eq=False)
class Performed:
    """What the source does in a clip."""

    paths: Paths  # of its joints, in metres
    rest: Places  # the same joints at rest
    times: Float[np.ndarray, " frames"]
    height: float  # of the source


def plant_feet(
    placed: Frames, rest: Places, legs: Sequence[Leg], performed: Performed, *, scale: float
) -> Frames:
    """Keep the feet of a carried clip where the source's stand.

    Hips rise or sink a little where a planted leg would have to change its bend much; no bone is
    stretched, feet keep their turns, knees the plane they bend in.

    Args:
        placed: world_from_joint of the figure, as the clip was carried over.
        rest: the figure's joints at rest.
        legs: of source and figure alike.
        performed: the same clip on the source.
        scale: figure to source, of the way the root travels.
    """
    paths, theirs, times = placed[..., :3, 3], performed.paths, performed.times
    least = LEAST_LEG * scale * performed.height
    legs = [leg for leg in legs if part_lengths(paths, leg).min() > least]
    contacts = [contacts_of(leg, performed) for leg in legs]
    if not any(found.touching.any() for found in contacts):
        return placed
    loops = is_loop(theirs, performed.height)
    wanted = [
        rest[leg.soles] + scale * (theirs[:, leg.soles] - performed.rest[leg.soles]) for leg in legs
    ]

    def goals(rise: Float[np.ndarray, " frames"]) -> list[Float[np.ndarray, "frames 3"]]:
        """Say where each foot belongs if the body rises as a whole."""
        lifted = paths + rise[:, None, None] * [0.0, 1.0, 0.0]
        found = []
        for leg, sought, touched in zip(legs, wanted, contacts, strict=True):
            missing = sought - lifted[:, leg.soles]
            shift = solve_corrections(missing, touched, times, loops=loops)
            shift = bound(shift, FARTHEST * leg_length(paths, leg))
            found.append(lifted[:, leg.foot] + shift)
        return found

    rise = ride_hips(paths, legs, goals(np.zeros(len(times))), contacts, times, loops=loops)
    planted = placed.copy()
    planted[..., 1, 3] += rise[:, None]
    for leg, goal in zip(legs, goals(rise), strict=True):
        move_foot(planted, leg, goal)
    return planted


def contacts_of(leg: Leg, performed: Performed) -> Contacts:
    """Find when a leg's foot is planted while the leg stands under the body."""
    drop, own = (
        p[..., leg.hip, 1] - p[..., leg.foot, 1] for p in (performed.paths, performed.rest)
    )
    return find_contacts(
        performed.paths[:, leg.soles],
        performed.rest[leg.soles, 1],
        performed.times,
        performed.height,
        bearing=drop > UNDER * own,
    )


def solve_corrections(
    missing: Float[np.ndarray, "frames soles 3"],
    contacts: Contacts,
    times: Float[np.ndarray, " frames"],
    *,
    loops: bool,
) -> Float[np.ndarray, "frames 3"]:
    """Solve for the smooth correction that takes what is missing out of every contact.

    Args:
        missing: from each sole to where it should be, along the ground but for a constant.
        contacts: of the same soles.
        times: of the frames.
        loops: the last frame is the first one again.
    """
    frames, widths = len(times), np.gradient(times)
    frame, sole = np.nonzero(contacts.numbers)
    if not len(frame):
        return np.zeros((frames, 3))
    _, anchor = np.unique(contacts.numbers[frame, sole], return_inverse=True)
    wanted, weight = missing[frame, sole], widths[frame] * contacts.stillness[frame, sole]
    still = FADING * (diags_array(widths) + bending_cost(times, loops=loops)).tocsc()
    vertical = still + csc_array(diags_array(np.bincount(frame, weight, frames)))
    shift = np.empty((frames, 3))
    shift[:, 1] = splu(vertical).solve(np.bincount(frame, weight * wanted[:, 1], frames))
    count = int(anchor.max()) + 1
    member = coo_array((weight, (frame, anchor)), shape=(frames, count))
    total = diags_array(np.bincount(anchor, weight, count))
    level = splu(block_array([[vertical, -member], [-member.T, total]], format="csc"))
    for axis in (0, 2):
        pull = weight * wanted[:, axis]
        sums = np.bincount(frame, pull, frames), -np.bincount(anchor, pull, count)
        shift[:, axis] = level.solve(np.concatenate(sums))[:frames]
    return shift


def bending_cost(times: Float[np.ndarray, " frames"], *, loops: bool) -> csc_array:
    """Give the matrix of tau^4 int |d''|^2 dt, by second differences; round the end if it loops."""
    frames, steps = len(times), np.diff(times)
    before, after = steps[:-1], steps[1:]
    middle, left, right = np.arange(1, frames - 1), np.arange(frames - 2), np.arange(2, frames)
    if loops:  # the last frame is the first
        middle, left, right = (
            np.append(middle, 0),
            np.append(left, frames - 2),
            np.append(right, 1),
        )
        before, after = np.append(before, steps[-1]), np.append(after, steps[0])
    width = (before + after) / 2
    rows = np.arange(len(middle))
    entries = np.concatenate([1 / before, -1 / before - 1 / after, 1 / after]) / np.tile(width, 3)
    places = np.tile(rows, 3), np.concatenate([left, middle, right])
    second = coo_array((entries, places), shape=(len(rows), frames)).tocsc()
    cost = SMOOTH**4 * second.T @ diags_array(width) @ second
    if loops:
        ends = np.array([0, frames - 1, 0, frames - 1]), np.array([0, frames - 1, frames - 1, 0])
        tie = coo_array((np.array([1.0, 1, -1, -1]), ends), shape=(frames, frames))
        cost = cost + 1e5 * float(times[-1] - times[0]) * tie
    return csc_array(cost)


def ride_hips(
    paths: Paths,
    legs: Sequence[Leg],
    goals: Sequence[Float[np.ndarray, "frames 3"]],
    contacts: Sequence[Contacts],
    times: Float[np.ndarray, " frames"],
    *,
    loops: bool,
) -> Float[np.ndarray, " frames"]:
    """Raise or lower the body, smoothly, so that planted legs need not bend otherwise than copied.

    Weighs the turn that each planted knee would need against the way of the hips: knees that are
    nearly straight turn far for little, so there the hips give way; bent ones give way themselves.
    """
    widths = np.gradient(times)
    length = min(leg_length(paths, leg) for leg in legs)
    cost = HEAVY / length**2 * (diags_array(widths) + bending_cost(times, loops=loops))
    rise = np.zeros(len(times))
    for _ in range(3):  # Gauss-Newton
        weight, pull = np.zeros(len(times)), np.zeros(len(times))
        for leg, goal, found in zip(legs, goals, contacts, strict=True):
            own = paths[:, leg.foot] - paths[:, leg.hip]
            way = goal - paths[:, leg.hip] - rise[:, None] * [0.0, 1.0, 0.0]
            reach, distance = np.linalg.norm(own, axis=1), np.linalg.norm(way, axis=1)
            slope = -way[:, 1] / np.maximum(distance, 1e-12)
            share = np.minimum(reach / leg_length(paths, leg), 1.0)
            knee = 4.0 / (length**2 * (1.0 - share**2 + STRAIGHT**2))  # (d angle / d reach)^2
            force = widths * found.touching * knee
            weight += force * slope**2
            pull += force * slope * (reach - distance + slope * rise)
        rise = splu((cost + diags_array(weight)).tocsc()).solve(pull)
    return np.clip(rise, -DEEPEST * length, DEEPEST * length)


def move_foot(planted: Frames, leg: Leg, goal: Float[np.ndarray, "frames 3"]) -> None:
    """Bend one leg, in place, so that its foot comes to the goal with the turn it had."""
    hip, knee, foot = (planted[:, joint, :3, 3].copy() for joint in (leg.hip, leg.knee, leg.foot))
    ahead = np.broadcast_to([0.0, 0.0, 1.0], hip.shape)
    axes = bending_axes(hip, knee, foot, planted[:, leg.hip, :3, :3], ahead)
    upper, lower = bend_limb(hip, knee, foot, goal, axes)
    bent_knee = hip + np.einsum("fab,fb->fa", upper, knee - hip)
    bent_foot = bent_knee + np.einsum("fab,fb->fa", lower, foot - knee)
    still = np.broadcast_to(np.eye(3), upper.shape)
    turn_rigidly(planted, leg.upper, upper, hip, hip)
    turn_rigidly(planted, leg.lower, lower, knee, bent_knee)
    turn_rigidly(planted, leg.end, still, foot, bent_foot)


def turn_rigidly(
    planted: Frames,
    joints: Int[np.ndarray, " moved"],
    turns: Float[np.ndarray, "frames 3 3"],
    about: Float[np.ndarray, "frames 3"],
    to: Float[np.ndarray, "frames 3"],
) -> None:
    """Turn some joints as one, in place, about a point that is moved to another."""
    frames = compose_transforms(to - np.einsum("fab,fb->fa", turns, about), turns)
    planted[:, joints] = frames[:, None] @ planted[:, joints]


def part_lengths(paths: Paths, leg: Leg) -> Float[np.ndarray, "frames 2"]:
    """Measure a leg from hip to knee, and from knee to foot, in metres."""
    bends = paths[:, [leg.hip, leg.knee, leg.foot]]
    return np.asarray(np.linalg.norm(np.diff(bends, axis=1), axis=2))


def leg_length(paths: Paths, leg: Leg) -> float:
    """Measure a leg from hip over knee to foot, in metres; the shortest it gets."""
    return float(part_lengths(paths, leg).sum(axis=1).min())


def bound(shift: Float[np.ndarray, "frames 3"], most: float) -> Float[np.ndarray, "frames 3"]:
    """Shorten corrections to at most this length."""
    length = np.linalg.norm(shift, axis=1, keepdims=True)
    return np.asarray(shift * np.minimum(1.0, most / np.maximum(length, 1e-12)))


def is_loop(joints: Float[np.ndarray, "frames joints 3"], height: float) -> bool:
    """Tell whether a clip ends in the pose it began with, wherever it has travelled to."""
    change = joints[-1] - joints[0]
    change[:, [0, 2]] -= change[0, [0, 2]]
    return bool(np.abs(change).max() < CLOSED * height)

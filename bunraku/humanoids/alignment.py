"""Make the rest poses of two human skeletons agree, bone by bone, twist included."""

import numpy as np
from jaxtyping import Float

from bunraku.humanoids.body import Body
from bunraku.humanoids.naming import ARM, LEG, SIDES
from bunraku.rotations import rotation_between

CLEAR_BEND = np.sin(np.radians(20.0))  # hinges bent less than this do not show their axis
STEADY = 0.8  # length of the weighted mean of unit axes; below it the axis wanders
FLAT_FOOT = np.cos(np.radians(50.0))  # a foot steeper than this at rest is not standing
_FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
_PHALANGES = ("Metacarpal", "Proximal", "Intermediate", "Distal")

Rotations = dict[str, Float[np.ndarray, "3 3"]]


def align_rests(
    source: Body, target: Body, turns: Float[np.ndarray, "frames joints 3 3"]
) -> Rotations:
    """Find the rotation of each bone of the target, at rest, into the source's rest direction.

    Args:
        turns: of the source's joints since rest, in the world; they show how its hinges bend.

    Returns:
        world rotation of every bone that both have and that is not part of trunk or neck, and of
        `trunk` itself.
    """
    trunk = source.frame @ target.frame.T
    aligned = {"trunk": trunk}
    for side in SIDES:
        if f"{side}Shoulder" in source.named and f"{side}Shoulder" in target.named:
            aligned[f"{side}Shoulder"] = trunk
        for roles in (LEG, ARM):
            bones = tuple(f"{side}{role}" for role in roles)
            aligned |= _align_limb(source, target, turns, bones=bones, parent=trunk)
        _align_foot(source, target, aligned, side)
        _align_hand(source, target, aligned, side)
    return aligned


def _align_limb(
    source: Body,
    target: Body,
    turns: Float[np.ndarray, "frames joints 3 3"],
    *,
    bones: tuple[str, ...],
    parent: Float[np.ndarray, "3 3"],
) -> Rotations:
    """Align the two long bones of a limb."""
    upper, lower, end = bones
    wanted, given = _direction(source, upper, lower), _direction(target, upper, lower)
    hinge = _shown_hinge(source, turns, bones)
    if hinge is None:
        first = rotation_between(parent @ given, wanted) @ parent
    else:
        natural = _natural_hinge(target, given, is_leg=upper.endswith("Leg"))
        first = _frame(wanted, hinge) @ _frame(given, natural).T
    wanted, given = _direction(source, lower, end), _direction(target, lower, end)
    return {upper: first, lower: rotation_between(first @ given, wanted) @ first}


def _direction(body: Body, bone: str, child: str) -> Float[np.ndarray, "3"]:
    """Give the way from one joint to another at rest."""
    return body.places[body.named[child]] - body.places[body.named[bone]]


def _frame(
    along: Float[np.ndarray, "3"], hinge: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """Build axes from a bone's direction and, as near as can be, its hinge."""
    along = along / np.linalg.norm(along)
    hinge = hinge - along * (hinge @ along)
    hinge = hinge / np.linalg.norm(hinge)
    return np.column_stack([along, hinge, np.cross(along, hinge)])


def _natural_hinge(
    body: Body, along: Float[np.ndarray, "3"], *, is_leg: bool
) -> Float[np.ndarray, "3"]:
    """Give the axis about which the lower bone bends: shins go back, forearms forward."""
    forward = body.frame[:, 2]
    return np.cross(along, -forward if is_leg else forward)


def _shown_hinge(
    source: Body, turns: Float[np.ndarray, "frames joints 3 3"], bones: tuple[str, ...]
) -> Float[np.ndarray, "3"] | None:
    """Find the axis, at rest, about which the source's joint bends; nothing if it does not show."""
    upper, lower, end = (source.named[bone] for bone in bones)
    places = source.places
    thigh = places[lower] - places[upper]
    thigh /= np.linalg.norm(thigh)
    shin = places[end] - places[lower]
    shin /= np.linalg.norm(shin)
    relative = np.swapaxes(turns[:, upper], -1, -2) @ turns[:, lower]
    axes = np.cross(thigh, relative @ shin)
    sines = np.linalg.norm(axes, axis=1)
    clear = sines > CLEAR_BEND
    if not clear.any():
        return None
    mean = axes[clear].sum(axis=0)
    return mean if np.linalg.norm(mean) > STEADY * sines[clear].sum() else None


def _align_foot(source: Body, target: Body, aligned: Rotations, side: str) -> None:
    """Align feet: flat ones by heading alone, so that flat stays flat; others by direction."""
    shin, foot, toes = f"{side}LowerLeg", f"{side}Foot", f"{side}Toes"
    aligned[foot] = aligned[shin]
    wanted, given = _beyond(source, foot), _beyond(target, foot)
    if wanted is not None and given is not None:
        aligned[foot] = rotation_between(aligned[shin] @ given, wanted) @ aligned[shin]
        if _is_flat(source, wanted) and _is_flat(target, given):
            turn = source.frame @ target.frame.T
            flat_given, flat_wanted = _level(source, turn @ given), _level(source, wanted)
            aligned[foot] = rotation_between(flat_given, flat_wanted) @ turn
    if toes in source.named and toes in target.named:
        aligned[toes] = aligned[foot]


def _is_flat(body: Body, along: Float[np.ndarray, "3"]) -> bool:
    """Tell whether a foot's direction lies about across the body's up."""
    return bool(np.linalg.norm(_level(body, along)) > FLAT_FOOT * np.linalg.norm(along))


def _level(body: Body, along: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Drop the part of a direction along the body's up."""
    up = body.frame[:, 1]
    return along - up * (along @ up)


def _beyond(body: Body, bone: str) -> Float[np.ndarray, "3"] | None:
    """Give the way from a joint to the mean of its children; nothing for a leaf."""
    joint = body.named[bone]
    side = "left" if bone.startswith("left") else "right"
    middle = body.named.get(f"{side}MiddleProximal") if bone.endswith("Hand") else None
    children = [middle] if middle is not None else body.tree.children[joint]
    if not children:
        return None
    way = body.places[children].mean(axis=0) - body.places[joint]
    return way if np.linalg.norm(way) > 1e-6 * body.leg_length else None


def _align_hand(source: Body, target: Body, aligned: Rotations, side: str) -> None:
    """Align the hand by its direction, and every finger bone after the one before it."""
    hand = f"{side}Hand"
    aligned[hand] = aligned[f"{side}LowerArm"]
    wanted, given = _beyond(source, hand), _beyond(target, hand)
    if wanted is not None and given is not None:
        aligned[hand] = rotation_between(aligned[hand] @ given, wanted) @ aligned[hand]
    for finger in _FINGERS:
        before = hand
        for phalanx in _PHALANGES:
            bone = f"{side}{finger}{phalanx}"
            if bone in source.named and bone in target.named:
                wanted, given = _beyond(source, bone), _beyond(target, bone)
                aligned[bone] = aligned[before]
                if wanted is not None and given is not None:
                    turn = rotation_between(aligned[before] @ given, wanted)
                    aligned[bone] = turn @ aligned[before]
                before = bone

"""People put together from rounded solids: dolls, chibis, blocks, with rigs known by construction.

The family `rounded` is for training; `blocks`, boxes in loose pieces, is kept for tests.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bunraku.neural.anatomy import PERSON
from bunraku.neural.bodies import Body
from bunraku.neural.solids import Share, Solid, assemble, place_solid

FAMILIES = ("rounded", "blocks")
_PARTS = len(PERSON.names)
_TORSO = ("hips", "spine", "chest", "upperChest", "neck")


@dataclass(frozen=True)
class Style:
    """How a family's solids look; lengths in heights."""

    exponent: tuple[float, float]  # 1 round, towards 0 boxes
    softness: tuple[float, float]  # share of a limb's length over which parts pass
    gap: tuple[float, float]  # between solids, as a share of a limb's length


STYLES = {
    "rounded": Style((0.45, 1.0), (0.05, 0.5), (-0.25, -0.02)),
    "blocks": Style((0.1, 0.4), (0.0, 0.02), (-0.02, 0.06)),
}


def sculpt_person(family: str, rng: np.random.Generator) -> Body:
    """Make a person in T pose, of random proportions from realistic to chibi."""
    style = STYLES[family]
    joints, size = person_joints(rng)
    shape = float(rng.uniform(*style.exponent)), float(rng.uniform(*style.softness))
    gap = float(rng.uniform(*style.gap))
    solids = [*_torso(joints, size, shape, rng), _head(joints, size, shape, rng)]
    for side in ("left", "right"):
        twin = np.random.default_rng(int(size["twin"]))  # both sides alike
        solids += _limb(joints, side, ("UpperArm", "LowerArm", "Hand"), size, (*shape, gap), twin)
        solids += _limb(joints, side, ("UpperLeg", "LowerLeg", "Foot"), size, (*shape, gap), twin)
    return assemble(family, "person", solids, joints)


def person_joints(
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "parts 3"], dict[str, float]]:
    """Draw proportions: how high, wide and long each part is, for a body of height 1."""
    head = float(rng.uniform(0.11, 0.2) if rng.random() < 0.4 else rng.uniform(0.2, 0.5))
    neck = float(rng.uniform(0.0, 0.06))
    below = 1 - head - neck
    leg = below * float(rng.uniform(0.33, 0.66))
    torso = below - leg
    ankle = leg * float(rng.uniform(0.08, 0.3))
    shoulder = float(rng.uniform(0.06, 0.16))
    hip = shoulder * float(rng.uniform(0.4, 0.9))
    arm = (torso + 0.5 * leg) * float(rng.uniform(0.5, 1.15))
    place = {name: np.zeros(3) for name in PERSON.names}

    heights = leg + torso * np.array([0.08, 0.28, 0.5, 0.72, 1.0])
    for name, height in zip(_TORSO, heights, strict=True):
        place[name] = np.array([0.0, height, 0.0])
    place["head"] = np.array([0.0, heights[-1] + neck, 0.0])
    lift = leg + torso * float(rng.uniform(0.76, 0.92))
    upper, knee = float(rng.uniform(0.4, 0.55)), float(rng.uniform(0.42, 0.58))
    hand = arm * float(rng.uniform(0.72, 0.88))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        place[side + "Shoulder"] = np.array([0.3 * sign * shoulder, lift, 0.0])
        for name, out in (("UpperArm", 0.0), ("LowerArm", upper * hand), ("Hand", hand)):
            place[side + name] = np.array([sign * (shoulder + out), lift, 0.0])
        high = ankle + (leg - ankle) * knee
        for name, height in (("UpperLeg", leg), ("LowerLeg", high), ("Foot", ankle)):
            place[side + name] = np.array([sign * hip, height, 0.0])
    size = {
        **{"head": head, "neck": neck, "leg": leg, "ankle": ankle, "shoulder": shoulder},
        **{"hip": hip, "arm": arm, "torso": torso, "twin": float(rng.integers(1 << 30))},
    }
    return np.stack([place[name] for name in PERSON.names]), size


def _torso(
    joints: np.ndarray, size: dict[str, float], shape: tuple[float, float], rng: np.random.Generator
) -> list[Solid]:
    """Make trunk and neck: one solid over all of the spine, or hips and chest apart."""
    exponent, softness = shape
    chain = [PERSON.index(name) for name in _TORSO]
    heights = joints[chain, 1]
    low = float(joints[PERSON.index("leftUpperLeg"), 1]) - 0.05 * size["torso"]
    start = np.array([0.0, low, 0.0])
    wide = max(size["shoulder"] * float(rng.uniform(0.75, 1.05)), 1.15 * size["hip"])
    deep = wide * float(rng.uniform(0.45, 1.0))
    bounds = tuple(float(h) - low for h in heights[1:4])
    share = Share(tuple(chain[:4]), bounds, max(softness, 0.02) * size["torso"] * 0.6)
    taper = float(rng.uniform(-0.3, 0.45))
    trunk = place_solid(
        np.stack([start, [0.0, float(heights[4]), 0.0]]),
        *((wide, deep), share, _PARTS),
        overhang=(0.08 * size["torso"], 0.0),
        form=(exponent, taper),
    )
    girth = size["head"] * float(rng.uniform(0.15, 0.35))
    tall = size["neck"]
    ends = np.stack([joints[chain[4]], joints[PERSON.index("head")] + [0, 0.02, 0]])
    own = Share((chain[3], chain[4], PERSON.index("head")), (0.0, tall), 0.3 * tall + 0.01)
    over = (0.3 * girth, 0.3 * girth)
    neck = place_solid(ends, (girth, girth), own, _PARTS, overhang=over, form=(exponent, 0.0))
    return [trunk, neck]


def _head(
    joints: np.ndarray, size: dict[str, float], shape: tuple[float, float], rng: np.random.Generator
) -> Solid:
    """Make the head; how it is long, wide and deep is drawn."""
    part = PERSON.index("head")
    start = joints[part]
    wide = size["head"] * float(rng.uniform(0.32, 0.65))
    deep = wide * float(rng.uniform(0.8, 1.25))
    chin = size["head"] * float(rng.uniform(0.0, 0.12))
    ends = start + size["head"] * np.array([[0.0, 0, 0], [0, 1.0, 0]])
    ends[:, 2] += size["head"] * float(rng.uniform(-0.05, 0.15))
    share = Share((part,), (), 0.01)
    form = float(rng.uniform(max(shape[0] - 0.3, 0.1), 1.0)), float(rng.uniform(-0.2, 0.3))
    return place_solid(ends, (wide, deep), share, _PARTS, overhang=(chin, 0.0), form=form)


def _limb(
    joints: np.ndarray,
    side: str,
    names: tuple[str, str, str],
    size: dict[str, float],
    shape: tuple[float, float, float],
    rng: np.random.Generator,
) -> list[Solid]:
    """Make an arm or a leg of three solids, mittens and shoes being the last of them."""
    exponent, softness, gap = shape
    first, second, third = (PERSON.index(side + name) for name in names)
    is_leg = names[-1] == "Foot"
    above = PERSON.index("hips" if is_leg else side + "Shoulder")
    length = float(np.linalg.norm(joints[third] - joints[first]))
    most = 0.95 * size["hip"] if is_leg else 0.3 * size["torso"]
    girth = min(length * float(rng.uniform(0.1, 0.32)), most)
    solids = []
    for part, before, after in ((first, above, second), (second, first, third)):
        bone = joints[after] - joints[part]
        long = float(np.linalg.norm(bone))
        share = Share((before, part, after), (0.0, long), softness * long)
        radius = girth * float(rng.uniform(0.75, 1.15))
        over = (-gap * long, -gap * long)
        form = (exponent, float(rng.uniform(-0.15, 0.35)))
        ends = joints[[part, after]]
        radii = (radius, radius)
        solids.append(place_solid(ends, radii, share, _PARTS, overhang=over, form=form))
    make = _foot if is_leg else _hand
    return [*solids, make(joints, (second, third), girth, (exponent, softness), size, rng)]


def _hand(
    joints: np.ndarray,
    parts: tuple[int, int],
    girth: float,
    shape: tuple[float, float],
    size: dict[str, float],
    rng: np.random.Generator,
) -> Solid:
    """Make a mitten or a ball at the end of the arm."""
    own = joints[parts[1]]
    along = own - joints[parts[0]]
    along /= np.linalg.norm(along)
    long = max(size["arm"] * float(rng.uniform(0.14, 0.3)), 1.2 * girth)
    ends = np.stack([own, own + along * long])
    share = Share(parts, (0.0,), 0.3 * shape[1] * long)
    thick = girth * float(rng.uniform(0.5, 1.4))
    radii = (girth * float(rng.uniform(0.7, 1.5)), thick)
    form = (shape[0], 0.0)
    return place_solid(ends, radii, share, _PARTS, overhang=(0.1 * long, 0.0), form=form)


def _foot(
    joints: np.ndarray,
    parts: tuple[int, int],
    girth: float,
    shape: tuple[float, float],
    size: dict[str, float],
    rng: np.random.Generator,
) -> Solid:
    """Make a shoe from the heel to the toe, as high as the ankle."""
    ankle = joints[parts[1]]
    long = max(size["leg"] * float(rng.uniform(0.25, 0.6)), 2 * girth)
    middle = 0.5 * size["ankle"]
    heel = np.array([ankle[0], middle, ankle[2] - float(rng.uniform(0.15, 0.4)) * long])
    ends = heel + long * np.array([[0.0, 0, 0], [0, 0, 1.0]])
    share = Share((parts[1],), (), 0.01)
    radii = (girth * float(rng.uniform(0.8, 1.4)), middle * float(rng.uniform(1.0, 1.4)))
    form = (shape[0], float(rng.uniform(-0.3, 0.3)))
    return place_solid(ends, radii, share, _PARTS, form=form)

"""Quadrupeds put together from rounded solids: ranges of proportions a species, rigs known.

Every species but those of HELD_OUT is for training.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bunraku.neural.anatomy import QUADRUPED
from bunraku.neural.bodies import Body
from bunraku.neural.solids import Share, Solid, assemble, place_solid

_PARTS = len(QUADRUPED.names)
Range = tuple[float, float]


@dataclass(frozen=True)
class Species:
    """Ranges of proportions; lengths in lengths of the trunk."""

    leg: Range
    neck: Range
    rise: Range  # of the neck over the horizontal, in degrees
    head: Range
    tail: Range
    girth: Range  # half the trunk's width
    limb: Range  # half a leg's width


# leg, neck, rise, head, tail, girth, limb
# fmt: off
_RANGES = {
    "dog": ((0.6, 1.1), (0.2, 0.4), (30.0, 70.0), (0.3, 0.55),
            (0.3, 0.8), (0.13, 0.25), (0.04, 0.08)),
    "cat": ((0.5, 0.8), (0.1, 0.25), (10.0, 50.0), (0.25, 0.5),
            (0.6, 1.0), (0.13, 0.22), (0.035, 0.07)),
    "horse": ((0.8, 1.2), (0.5, 0.8), (35.0, 70.0), (0.4, 0.55),
              (0.4, 0.9), (0.16, 0.26), (0.035, 0.07)),
    "cow": ((0.5, 0.8), (0.2, 0.4), (-10.0, 35.0), (0.3, 0.45),
            (0.4, 0.8), (0.2, 0.32), (0.05, 0.09)),
    "pig": ((0.25, 0.5), (0.05, 0.2), (-15.0, 20.0), (0.3, 0.5),
            (0.1, 0.3), (0.22, 0.36), (0.05, 0.1)),
    "deer": ((0.9, 1.3), (0.4, 0.7), (45.0, 80.0), (0.25, 0.4),
             (0.08, 0.25), (0.14, 0.22), (0.025, 0.05)),
    "giraffe": ((1.1, 1.6), (1.0, 1.7), (50.0, 80.0), (0.3, 0.45),
                (0.3, 0.7), (0.18, 0.26), (0.035, 0.06)),
    "toy": ((0.3, 0.9), (0.02, 0.3), (20.0, 85.0), (0.4, 0.9),
            (0.1, 0.9), (0.18, 0.36), (0.05, 0.12)),
    "hippo": ((0.3, 0.5), (0.1, 0.25), (-20.0, 15.0), (0.45, 0.65),
              (0.1, 0.3), (0.28, 0.4), (0.08, 0.13)),
}
# fmt: on
SPECIES = {name: Species(*ranges) for name, ranges in _RANGES.items()}
HELD_OUT = ("hippo",)


def sculpt_quadruped(species: str, rng: np.random.Generator) -> Body:
    """Make a standing quadruped of a species."""
    joints, size = quadruped_joints(SPECIES[species], rng)
    shape = float(rng.uniform(0.45, 1.0)), float(rng.uniform(0.05, 0.4))
    solids = [*_trunk(joints, size, shape, rng), *_head(joints, size, shape, rng)]
    for side in ("left", "right"):
        for end, above in (("Front", "chest"), ("Hind", "hips")):
            twin = np.random.default_rng(int(size["twin"]) + len(end))  # both sides alike
            solids += _leg(joints, (side + end, above), size, shape, twin)
    return assemble(species, "quadruped", solids, joints)


def quadruped_joints(
    species: Species, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "parts 3"], dict[str, float]]:
    """Draw proportions and a stance: the trunk along Z from the hips at 0 to the chest at 1."""
    draw = {
        name: float(rng.uniform(*getattr(species, name))) for name in Species.__dataclass_fields__
    }
    draw["twin"] = float(rng.integers(1 << 30))
    high = draw["leg"]
    place = {name: np.zeros(3) for name in QUADRUPED.names}
    for name, along in (("hips", 0.05), ("spine", 0.35), ("chest", 0.68)):
        place[name] = np.array([0.0, high + float(rng.uniform(0.0, 0.08)), along])
    rise = np.radians(draw["rise"])
    toward = np.array([0.0, np.sin(rise), np.cos(rise)])
    place["neck"] = np.array([0.0, high + 0.5 * draw["girth"], 0.95])
    place["head"] = place["neck"] + toward * draw["neck"]
    fall = np.radians(float(rng.uniform(-80, 40)))
    back = np.array([0.0, np.sin(fall), -np.cos(fall)]) * draw["tail"]
    place["tail"] = np.array([0.0, high + 0.4 * draw["girth"], -0.08])
    place["tailTip"] = place["tail"] + 0.5 * back
    draw["back_y"], draw["back_z"] = float(back[1]), float(back[2])
    wide = draw["girth"] * float(rng.uniform(0.45, 0.75))
    for end, where, bend in (("Front", 0.85, -1.0), ("Hind", 0.02, 1.0)):
        knee, hock = float(rng.uniform(0.55, 0.7)), float(rng.uniform(0.12, 0.36))
        bow = float(rng.uniform(0.0, 0.12)) * bend * high
        top = high * float(rng.uniform(0.95, 1.05))
        levels = (
            ("UpperLeg", top, 0.0),
            ("LowerLeg", knee * high, bow),
            ("Foot", hock * high, -bow),
        )
        for side, sign in (("left", 1.0), ("right", -1.0)):
            for name, level, ahead in levels:
                place[side + end + name] = np.array([sign * wide, level, where + ahead])
    return np.stack([place[name] for name in QUADRUPED.names]), draw


def _trunk(
    joints: np.ndarray, size: dict[str, float], shape: tuple[float, float], rng: np.random.Generator
) -> list[Solid]:
    """Make trunk, neck and tail."""
    at = QUADRUPED.index
    hips, spine, chest, neck, head = map(at, ("hips", "spine", "chest", "neck", "head"))
    middle = float(joints[[hips, spine, chest], 1].mean())
    ends = np.array([[0.0, middle, -0.05], [0.0, middle, 1.0]])
    bounds = tuple(float(joints[part, 2]) + 0.05 for part in (spine, chest))
    share = Share((hips, spine, chest), bounds, max(shape[1], 0.1) * 0.5)
    tall = size["girth"] * float(rng.uniform(0.9, 1.4))
    form = shape[0], float(rng.uniform(-0.3, 0.2))
    radii = (size["girth"], tall)
    solids = [place_solid(ends, radii, share, _PARTS, overhang=(0.1, 0.06), form=form)]

    long = max(float(np.linalg.norm(joints[head] - joints[neck])), 1e-3)
    share = Share((chest, neck, head), (0.0, long), max(shape[1], 0.1) * long)
    thick = min(size["girth"] * float(rng.uniform(0.4, 0.8)), 0.6 * size["head"])
    over = (0.4 * thick, 0.3 * thick)
    form = shape[0], float(rng.uniform(0.0, 0.4))
    pair = joints[[neck, head]] + [[0, 0, 0], [0, 1e-3, 0]]
    solids.append(place_solid(pair, (thick, thick), share, _PARTS, overhang=over, form=form))

    tail, tip = at("tail"), at("tailTip")
    back = np.array([0.0, size["back_y"], size["back_z"]])
    share = Share((hips, tail, tip), (0.0, 0.5 * size["tail"]), shape[1] * size["tail"] * 0.5)
    thick = size["tail"] * float(rng.uniform(0.04, 0.16))
    ends = np.stack([joints[tail], joints[tail] + back])
    form = shape[0], float(rng.uniform(-0.4, 0.5))
    over = (0.1 * size["tail"], 0.0)
    solids.append(place_solid(ends, (thick, thick), share, _PARTS, overhang=over, form=form))
    return solids


def _head(
    joints: np.ndarray, size: dict[str, float], shape: tuple[float, float], rng: np.random.Generator
) -> list[Solid]:
    """Make skull, muzzle and ears."""
    part = QUADRUPED.index("head")
    own, long = joints[part], size["head"]
    share = Share((part,), (), 0.01)
    dip = np.radians(float(rng.uniform(-60, 5)))
    toward = np.array([0.0, np.sin(dip), np.cos(dip)])
    wide = long * float(rng.uniform(0.22, 0.45))
    skull = np.stack([own, own + toward * long * 0.55])
    over = (0.15 * long, 0.05 * long)
    solids = [place_solid(skull, (wide, wide), share, _PARTS, overhang=over, form=(shape[0], 0.0))]
    if rng.random() < 0.9:
        narrow = wide * float(rng.uniform(0.4, 0.85))
        muzzle = np.stack([own + toward * 0.3 * long, own + toward * long])
        form = (shape[0], float(rng.uniform(0, 0.3)))
        solids.append(place_solid(muzzle, (narrow, narrow), share, _PARTS, form=form))
    if rng.random() < 0.85:
        tall, thick = long * float(rng.uniform(0.1, 0.5)), wide * float(rng.uniform(0.1, 0.35))
        lean = float(rng.uniform(0.0, 0.8))
        for sign in (1.0, -1.0):
            root = own + np.array([sign * 0.6 * wide, 0.7 * wide, 0.1 * long])
            ends = np.stack([root, root + tall * np.array([sign * lean, 1.0, 0.0])])
            form = (1.0, float(rng.uniform(0.0, 0.6)))
            solids.append(place_solid(ends, (thick, 0.5 * thick), share, _PARTS, form=form))
    return solids


def _leg(
    joints: np.ndarray,
    place: tuple[str, str],
    size: dict[str, float],
    shape: tuple[float, float],
    rng: np.random.Generator,
) -> list[Solid]:
    """Make a leg of three solids, the last one down to the floor, with a paw or hoof."""
    limb, above = place
    chain = [QUADRUPED.index(limb + name) for name in ("UpperLeg", "LowerLeg", "Foot")]
    parts = [QUADRUPED.index(above), *chain]
    sole = joints[chain[2]] * [1.0, 0.0, 1.0]
    points = [*joints[chain], sole + np.array([0.0, 0.0, 0.02])]
    solids = []
    for i, thick in enumerate((float(rng.uniform(1.2, 2.2)), float(rng.uniform(0.9, 1.3)), 1.0)):
        ends = np.stack(points[i : i + 2])
        long = float(np.linalg.norm(ends[1] - ends[0]))
        after = tuple(parts[i : i + 3])
        bounds = (0.0, long)[: len(after) - 1]
        share = Share(after, bounds, shape[1] * long)
        radius = size["limb"] * thick
        over = ((0.35 if i == 0 else 0.15) * long, 0.15 * long if i < 2 else 0.0)
        form = (shape[0], float(rng.uniform(0.0, 0.35)))
        radii = (radius, radius * float(rng.uniform(0.9, 1.5)))
        solids.append(place_solid(ends, radii, share, _PARTS, overhang=over, form=form))
    paw = size["limb"] * float(rng.uniform(1.0, 1.6))
    ends = sole + np.array([[0, 0.6 * paw, -paw], [0, 0.6 * paw, 1.6 * paw]])
    share = Share((chain[2],), (), 0.01)
    solids.append(place_solid(ends, (paw, 0.6 * paw), share, _PARTS, form=(shape[0], 0.0)))
    return solids

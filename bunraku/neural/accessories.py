"""What figures wear and carry: hats, hair, packs, capes, skirts, tails, things in the hand."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bunraku.neural.bodies import Body
from bunraku.neural.solids import Share, Solid, assemble, place_solid, ramp_weights

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Piece:
    """Something worn: a solid beside the box around the vertices of the part that it follows."""

    parts: tuple[str, ...]  # one of them wears it; without their side, if they have one
    place: Triple  # of its middle in the box, from -1 to 1 on each side; x outwards
    size: Triple  # half its width, height, depth, in those of the box
    sides: int = 1  # 2 for pairs, 0 for one or both as drawn
    longest: float = 0.35  # half its extent at most, in heights


_HELD = ("Hand", "LowerArm")
_PIECES = {
    "hat": Piece(("head",), (0.0, 1.0, -0.1), (1.1, 0.7, 1.1)),
    "brim": Piece(("head",), (0.0, 0.55, 0.0), (1.6, 0.15, 1.6)),
    "hair": Piece(("head",), (0.0, 0.1, -0.7), (1.1, 1.3, 0.8)),
    "long hair": Piece(("head",), (0.0, -0.9, -0.9), (0.9, 1.5, 0.4)),
    "horns": Piece(("head",), (0.9, 0.6, 0.0), (0.35, 0.7, 0.3), 2),
    "ears": Piece(("head",), (0.5, 1.6, 0.0), (0.25, 1.0, 0.2), 2),
    "nose": Piece(("head",), (0.0, -0.2, 1.0), (0.3, 0.3, 0.5)),
    "beard": Piece(("head",), (0.0, -0.9, 0.7), (0.7, 0.7, 0.4)),
    "pack": Piece(("upperChest", "chest"), (0.0, 0.0, -1.3), (1.2, 1.6, 0.8)),
    "cape": Piece(("upperChest", "chest", "spine"), (0.0, -0.5, -1.2), (1.7, 3.5, 0.2), 1, 0.45),
    "belt": Piece(("hips", "spine"), (0.0, 0.6, 0.0), (1.15, 0.5, 1.15)),
    "pad": Piece(("UpperArm", "UpperArm", "Shoulder"), (0.0, 0.5, 0.0), (0.7, 1.3, 1.3), 2),
    "blade": Piece(_HELD[:1], (0.3, 0.0, 1.5), (0.5, 0.6, 8.0), 0, 0.5),
    "staff": Piece(_HELD[:1], (0.3, 0.8, 0.3), (0.3, 6.0, 0.3), 0, 0.5),
    "club": Piece(_HELD[:1], (0.3, 0.3, 1.8), (0.9, 1.2, 1.6), 0, 0.5),
    "shield": Piece(_HELD, (0.5, 0.0, 1.0), (2.0, 5.0, 0.6), 0),
    "cuff": Piece(_HELD[1:], (0.4, 0.0, 0.0), (0.4, 1.4, 1.4), 2),
    "boot": Piece(("LowerLeg",), (0.0, -0.6, 0.0), (1.3, 0.9, 1.3), 2),
    "mane": Piece(("neck",), (0.0, 0.6, -0.5), (0.5, 1.2, 1.0)),
    "saddle": Piece(("spine",), (0.0, 0.8, 0.0), (1.1, 0.4, 0.9)),
}
_SIDES = ("left", "right")
SKIRT = 0.12  # how often people wear one


def dress_up(body: Body, rng: np.random.Generator, *, most: int = 4) -> Body:
    """Give a body some pieces that follow one part each, and some people a skirt; weights exact."""
    names = body.anatomy.names
    known = {*names, *(name.removeprefix(side) for name in names for side in _SIDES)}
    fitting = [name for name, piece in _PIECES.items() if known.issuperset(piece.parts)]
    chosen = rng.choice(fitting, size=int(rng.integers(0, most + 1)), replace=False)
    solids = [Solid(body.mesh.vertices, body.mesh.faces, body.weights)]
    for name in chosen:
        solids += _wear(body, _PIECES[name], rng)
    if body.kind == "person" and rng.random() < SKIRT:
        solids.append(_skirt(body, rng))
    return assemble(body.family, body.kind, solids, body.joints)


def _wear(body: Body, piece: Piece, rng: np.random.Generator) -> list[Solid]:
    """Put a piece on: alike on both sides, or on one."""
    names = body.anatomy.names
    part = str(rng.choice(piece.parts))
    scale = np.exp(rng.normal(0, 0.3, 3))
    form = float(rng.uniform(0.15, 1.0)), float(rng.uniform(-0.3, 0.7))
    sides = piece.sides or int(rng.integers(1, 3))
    first = 0 if sides == 2 else int(rng.integers(0, 2))
    solids = []
    for side, sign in list(zip(_SIDES, (1.0, -1.0), strict=True))[first : first + sides]:
        wearer = names.index(part if part in names else side + part)
        place = np.array(piece.place) * [sign, 1, 1]
        solids += _place(body, wearer, place, np.array(piece.size) * scale, piece.longest, form)
    return solids


def _place(
    body: Body,
    part: int,
    place: Float[np.ndarray, "3"],
    size: Float[np.ndarray, "3"],
    longest: float,
    form: tuple[float, float],
) -> list[Solid]:
    """Put a solid beside the box around a part's own vertices, if it has any."""
    own = body.mesh.vertices[body.weights[:, part] > 0.5]
    if len(own) < 4:
        return []
    low, high = np.percentile(own, [2, 98], axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-3)
    centre, reach = middle + place * half, np.minimum(half * size, longest)
    ends = centre + reach[1] * np.array([[0, -1.0, 0], [0, 1.0, 0]])
    share = Share((part,), (), 0.01)
    radii = (float(reach[0]), float(reach[2]))
    return [place_solid(ends, radii, share, len(body.joints), form=form)]


def _skirt(body: Body, rng: np.random.Generator) -> Solid:
    """Hang a skirt about the legs: it passes from the hips to the leg of its side."""
    hips, *legs = (body.anatomy.index(n) for n in ("hips", "leftUpperLeg", "rightUpperLeg"))
    foot = body.joints[body.anatomy.index("leftFoot")]
    top = body.joints[legs].mean(axis=0)
    top[1] += 0.1 * float(rng.uniform(0, 1))
    length = max(top[1] - foot[1], 0.02) * float(rng.uniform(0.4, 1.0))
    wide = 2.0 * abs(float(body.joints[legs[0], 0])) * float(rng.uniform(0.9, 1.6)) + 0.01
    ends = np.stack([top, top - [0.0, length, 0.0]])
    radii = (wide, wide * float(rng.uniform(0.6, 1.0)))
    form = (float(rng.uniform(0.4, 1.0)), -float(rng.uniform(0.2, 0.6)))
    skirt = place_solid(ends, radii, Share((hips,), (), 0.01), len(body.joints), form=form)
    share = Share((0, 1), (float(rng.uniform(0.2, 0.5)) * length,), 0.5 * length)
    below = ramp_weights(top[1] - skirt.vertices[:, 1], share)[:, 1]
    side = np.clip(skirt.vertices[:, 0] / wide + 0.5, 0, 1)
    weights = np.zeros_like(skirt.weights)
    weights[:, hips] = 1 - below
    weights[:, legs[0]], weights[:, legs[1]] = below * side, below * (1 - side)
    return Solid(skirt.vertices, skirt.faces, weights)

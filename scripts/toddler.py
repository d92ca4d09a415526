"""The stylised figure: a child explorer with a big head, hat, scarf, mittens and a backpack."""

import dataclasses

import numpy as np
from sculpting import (
    Piece,
    Shape,
    box,
    chain,
    cut,
    ellipsoid,
    flipped,
    height_on,
    limb,
    mirrored,
    normals_of,
    part_of,
    ring,
    sculpted,
    union,
    without,
)

SKIN, HAIR, INK, WHITE = (240, 196, 160), (122, 70, 40), (38, 32, 44), (250, 250, 250)
COAT, TROUSERS, BOOTS, BLUSH = (52, 120, 150), (74, 78, 112), (120, 72, 46), (240, 150, 130)
HAT, SCARF, MITTENS, PACK = (214, 76, 66), (244, 188, 70), (230, 108, 88), (150, 108, 66)
LEATHER, BLANKET, LIPS = (96, 62, 40), (120, 150, 90), (160, 70, 66)
DOTS = {"eye": INK, "glint": WHITE, "blush": BLUSH}
NECK, HEM, SHAFT = 0.585, 0.375, 0.155  # heights where collar, coat and boots end


def head() -> Shape:
    """Shape the head: skull, full cheeks, chin, nose and ears."""
    cheeks = mirrored(ellipsoid((0.085, 0.735, 0.055), (0.085, 0.075, 0.085)))
    skull = union(ellipsoid((0.0, 0.815, 0.0), (0.178, 0.172, 0.165)), cheeks, blend=0.05)
    chin = ellipsoid((0.0, 0.672, 0.075), (0.05, 0.035, 0.05))
    nose = ellipsoid((0.0, 0.765, 0.172), (0.023, 0.02, 0.024))
    ears = mirrored(ellipsoid((0.178, 0.775, -0.005), (0.022, 0.042, 0.034)))
    return union(union(skull, chin, blend=0.06), union(nose, ears), blend=0.018)


def body() -> Shape:
    """Shape everything that is one skin: head, coat, arms, trousers, boots."""
    torso = union(
        limb((0.0, 0.405, 0.0), (0.0, 0.525, -0.005), (0.118, 0.088)),
        ellipsoid((0.0, 0.395, 0.012), (0.128, 0.075, 0.118)),
        blend=0.05,
    )
    arm = chain(
        ((0.075, 0.54, 0.0), (0.20, 0.475, 0.0), (0.315, 0.395, 0.03)), (0.05, 0.044, 0.036)
    )
    hand = ellipsoid((0.345, 0.375, 0.036), (0.036, 0.034, 0.034))
    leg = chain(
        ((0.068, 0.36, 0.0), (0.078, 0.22, 0.006), (0.086, 0.09, 0.0)), (0.074, 0.064, 0.055)
    )
    shaft = limb((0.086, 0.135, 0.0), (0.086, 0.075, 0.0), (0.066, 0.062))
    toe = ellipsoid((0.092, 0.05, 0.055), (0.062, 0.05, 0.092))
    foot = union(shaft, toe, blend=0.04)
    limbs = union(mirrored(union(arm, hand, blend=0.02)), mirrored(union(leg, foot, blend=0.012)))
    neck = limb((0.0, 0.54, -0.005), (0.0, 0.68, 0.0), (0.055, 0.06))
    whole = union(union(torso, limbs, blend=0.045), union(neck, head(), blend=0.03), blend=0.02)
    floor = box((0.0, -0.5, 0.0), (2.0, 0.5, 2.0), 0.0)
    return without(whole, floor)


def dressed_body() -> list[Piece]:
    """Polygonise the body and cut it where one cloth ends and the next begins."""
    shape, bounds = body(), ((-0.42, -0.03, -0.22), (0.42, 1.03, 0.24))
    whole = sculpted("body", shape, 0.011, bounds=bounds, colour=SKIN, faces=5000)
    vertices, faces = whole.vertices, whole.faces
    for level in (NECK, HEM, SHAFT):
        vertices, faces = cut(vertices, faces, above(vertices, level))
    whole = Piece("body", vertices, faces, SKIN, normals_of(shape, vertices))
    middles = vertices[faces].mean(axis=1)
    band = sum((above(middles, level) > 0).astype(int) for level in (NECK, HEM, SHAFT))
    cloths = (("boots", BOOTS), ("trousers", TROUSERS), ("coat", COAT), ("skin", SKIN))
    return [part_of(whole, name, faces[band == i], cloth) for i, (name, cloth) in enumerate(cloths)]


def above(points: np.ndarray, level: float) -> np.ndarray:
    """Tell how far points are above a level; an arm is above all but the collar."""
    arm = (np.abs(points[:, 0]) > 0.165) & (points[:, 1] > 0.3) & (level < NECK)
    return np.where(arm, 1.0, points[:, 1] - level)


def around(points: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
    """Give the corners of a box round points."""
    return np.min(points, axis=0) - margin, np.max(points, axis=0) + margin


def face_parts() -> list[Piece]:
    """Put eyes with a glint, brows, blush and a smile on the head."""
    front = head()

    def on_head(*places: tuple[float, float]) -> list[tuple[float, float, float]]:
        return [(x, y, height_on(front, x, y)) for x, y in places]

    def dot(name: str, place: tuple[float, float, float], radii: tuple[float, ...]) -> Piece:
        bounds = around(np.array([place]), max(radii) * 1.3)
        return sculpted(
            name, ellipsoid(place, radii), max(radii) / 5, bounds=bounds, colour=DOTS[name]
        )

    eye, blush = on_head((0.068, 0.79), (0.108, 0.733))
    brow = on_head((0.040, 0.853), (0.070, 0.862), (0.100, 0.848))
    smile = on_head(*((x, 0.703 + 4.0 * x * x) for x in np.linspace(-0.052, 0.052, 7)))
    left = [
        dot("eye", eye, (0.027, 0.038, 0.012)),
        dot("glint", (eye[0] + 0.009, eye[1] + 0.014, eye[2] + 0.010), (0.008, 0.010, 0.005)),
        dot("blush", blush, (0.030, 0.021, 0.010)),
        tube("brow", brow, (0.007, 0.009, 0.006), 0.006, HAIR),
    ]
    mouth = tube("mouth", smile, (0.004, 0.006, 0.007, 0.007, 0.007, 0.006, 0.004), 0.0048, LIPS)
    pairs = [dataclasses.replace(piece, name=f"left_{piece.name}") for piece in left]
    return [*pairs, *(flipped(piece, f"right_{piece.name}") for piece in left), mouth]


def tube(
    name: str,
    points: list[tuple[float, float, float]],
    radii: tuple[float, ...],
    step: float,
    colour: tuple[int, int, int],
) -> Piece:
    """Make a closed tube through points."""
    bounds = around(np.array(points), max(radii) + step)
    return sculpted(name, chain(points, radii), step, bounds=bounds, colour=colour)


def hair() -> Piece:
    """Shape hair: the skull made larger, away from the face."""
    cap = union(
        ellipsoid((0.0, 0.818, -0.010), (0.192, 0.182, 0.176)),
        ellipsoid((0.0, 0.74, -0.06), (0.165, 0.12, 0.12)),
        blend=0.05,
    )
    face = ellipsoid((0.0, 0.735, 0.16), (0.158, 0.150, 0.15))
    fringe = mirrored(limb((0.02, 0.905, 0.155), (0.13, 0.84, 0.125), (0.028, 0.018)))
    shape, bounds = (
        union(without(cap, face), fringe, blend=0.02),
        ((-0.22, 0.58, -0.22), (0.22, 1.04, 0.22)),
    )
    return sculpted("hair", shape, 0.011, bounds=bounds, colour=HAIR, faces=1000)


def hat() -> list[Piece]:
    """Make a woollen hat: an open cap, a thick rim, a pompom."""

    def over_rim(points: np.ndarray) -> np.ndarray:
        return points[:, 1] - 0.900 - 0.16 * points[:, 2]  # higher over the brow

    shell = ellipsoid((0.0, 0.872, -0.012), (0.209, 0.185, 0.197))
    bounds = ((-0.24, 0.66, -0.24), (0.24, 1.09, 0.22))
    ball = sculpted("hat", shell, 0.023, bounds=bounds, colour=HAT)
    vertices, faces = cut(ball.vertices, ball.faces, over_rim(ball.vertices))
    ball = Piece("hat", vertices, faces, HAT, normals_of(shell, vertices))
    cap = part_of(ball, "hat", faces[over_rim(vertices[faces].mean(axis=1)) > 0], HAT)

    def tilted(points: np.ndarray) -> np.ndarray:
        level = np.stack([points[:, 0], over_rim(points), points[:, 2] + 0.012], axis=1)
        return ring((0.0, 0.0, 0.0), (0.203, 0.191), 0.026)(level)

    bounds = ((-0.25, 0.82, -0.25), (0.25, 0.98, 0.23))
    rim = sculpted("hat_rim", tilted, 0.0165, bounds=bounds, colour=WHITE, faces=1000)
    bounds = ((-0.08, 1.0, -0.1), (0.08, 1.16, 0.06))
    return [cap, rim, sculpted("pompom", pompom(), 0.014, bounds=bounds, colour=WHITE)]


def pompom() -> Shape:
    """Shape a ball of tufts, evenly round a spiral."""
    middle, turn = np.array([0.0, 1.082, -0.02]), np.arange(30)
    height = 1 - (turn + 0.5) / 15
    level = np.sqrt(1 - height**2)
    directions = np.stack([level * np.sin(2.4 * turn), height, level * np.cos(2.4 * turn)], axis=1)
    tufts = [ellipsoid(middle + 0.036 * direction, (0.021,) * 3) for direction in directions]
    return union(ellipsoid(middle, (0.043,) * 3), *tufts, blend=0.01)


def ribbon(
    name: str, middle: np.ndarray, across: np.ndarray, colour: tuple[int, int, int]
) -> Piece:
    """Make an open strip along a line of points, `across` giving half its width, to its left."""
    shares = np.linspace(-1.0, 1.0, 4)
    vertices = (middle[:, None] + shares[:, None] * across[:, None]).reshape(-1, 3)
    at = np.arange(len(vertices)).reshape(len(middle), len(shares))
    a, b, c, d = at[:-1, :-1].ravel(), at[1:, :-1].ravel(), at[1:, 1:].ravel(), at[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Piece(name, vertices, faces, colour)


def scarf() -> list[Piece]:
    """Wind a scarf: two thick rings round the neck, and a tail that hangs open in front."""
    winding = union(
        ring((0.0, 0.575, 0.004), (0.088, 0.088), 0.034),
        ring((0.0, 0.612, 0.006), (0.082, 0.084), 0.030),
        blend=0.012,
    )
    bounds = ((-0.14, 0.52, -0.14), (0.14, 0.67, 0.15))
    wound = sculpted("scarf", winding, 0.0145, bounds=bounds, colour=SCARF, faces=1200)
    coat, heights = body(), np.linspace(0.585, 0.385, 12)
    depths = [max(height_on(coat, 0.06, y), 0.108) + 0.01 for y in heights]
    middle = np.stack([0.055 + 0.10 * (0.585 - heights), heights, depths], axis=1)
    across = np.tile([0.030, 0.006, -0.004], (len(middle), 1))
    return [wound, ribbon("scarf_tail", middle, across, SCARF)]


def mitten() -> Piece:
    """Make the left mitten: a fist with a thumb and a cuff."""
    fist = ellipsoid((0.357, 0.366, 0.038), (0.052, 0.046, 0.043))
    thumb = limb((0.345, 0.385, 0.065), (0.372, 0.383, 0.092), (0.02, 0.017))
    cuff = limb((0.300, 0.407, 0.027), (0.318, 0.394, 0.030), (0.047, 0.045))
    shape = union(union(fist, thumb, blend=0.02), cuff, blend=0.008)
    bounds = ((0.22, 0.29, -0.04), (0.44, 0.48, 0.14))
    return sculpted("left_mitten", shape, 0.0105, bounds=bounds, colour=MITTENS, faces=700)


def backpack() -> list[Piece]:
    """Make a backpack with a pocket and a rolled blanket."""
    sack = union(
        box((0.0, 0.475, -0.165), (0.105, 0.11, 0.06), 0.045),
        box((0.0, 0.445, -0.225), (0.07, 0.055, 0.03), 0.025),
        blend=0.012,
    )
    roll = limb((-0.10, 0.60, -0.165), (0.10, 0.60, -0.165), (0.036, 0.036))
    bounds = (
        ((-0.13, 0.34, -0.28), (0.13, 0.61, -0.08)),
        ((-0.16, 0.55, -0.22), (0.16, 0.65, -0.11)),
    )
    return [
        sculpted("backpack", sack, 0.0125, bounds=bounds[0], colour=PACK, faces=1100),
        sculpted("blanket", roll, 0.0135, bounds=bounds[1], colour=BLANKET, faces=500),
    ]


def strap() -> Piece:
    """Lay an open strap round the left shoulder, on the coat."""
    coat, shoulder = body(), np.array([0.085, 0.475, 0.0])
    turns = np.radians(np.linspace(235.0, -36.0, 24))
    ways = np.stack([0.0 * turns, np.sin(turns), np.cos(turns)], axis=1)
    far = np.linspace(0.02, 0.3, 400)
    inside = np.stack([coat(shoulder + reach * ways) < 0 for reach in far], axis=1)
    reach = far[inside.argmin(axis=1)] + 0.006
    middle = shoulder + reach[:, None] * ways
    return ribbon("left_strap", middle, np.tile([0.017, 0.0, 0.0], (len(middle), 1)), LEATHER)


def buttons() -> list[Piece]:
    """Put three buttons on the coat."""
    coat = body()
    places = [(0.0, y, height_on(coat, 0.0, y) + 0.002) for y in (0.50, 0.455, 0.41)]
    shapes = [ellipsoid(place, (0.012, 0.012, 0.006)) for place in places]
    return [
        sculpted(f"button_{i}", shape, 0.005, bounds=around(np.array([place]), 0.018), colour=SCARF)
        for i, (place, shape) in enumerate(zip(places, shapes, strict=True), start=1)
    ]


def stylised() -> list[Piece]:
    """Make the whole figure."""
    left = [mitten(), strap()]
    right = [flipped(piece, piece.name.replace("left", "right")) for piece in left]
    return [
        *dressed_body(),
        hair(),
        *face_parts(),
        *hat(),
        *scarf(),
        *left,
        *right,
        *backpack(),
        *buttons(),
    ]

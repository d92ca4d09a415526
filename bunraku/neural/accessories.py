"""What figures wear and carry: hats, hair, packs, capes, horns, tails, things in the hand."""

import numpy as np

from bunraku.neural.bodies import Body
from bunraku.neural.solids import Share, Solid, assemble, place_solid

# part, where on the part's box (-1 to 1 a side), size in boxes, how many sides
_WORN = {
    "hat": ("head", (0.0, 1.0, -0.1), (1.1, 0.7, 1.1), 1),
    "brim": ("head", (0.0, 0.55, 0.0), (1.6, 0.15, 1.6), 1),
    "hair": ("head", (0.0, 0.1, -0.7), (1.1, 1.3, 0.8), 1),
    "ear": ("head", (0.9, 0.6, 0.0), (0.35, 0.7, 0.3), 2),
    "nose": ("head", (0.0, -0.2, 1.0), (0.3, 0.3, 0.5), 1),
    "pack": ("upperChest", (0.0, 0.0, -1.3), (1.2, 1.6, 0.8), 1),
    "cape": ("chest", (0.0, -0.5, -1.2), (1.7, 3.5, 0.2), 1),
    "belt": ("hips", (0.0, 0.6, 0.0), (1.15, 0.5, 1.15), 1),
    "pad": ("UpperArm", (0.0, 0.5, 0.0), (0.7, 1.3, 1.3), 2),
    "blade": ("rightHand", (0.3, 0.0, 1.5), (0.5, 0.6, 8.0), 1),
    "shield": ("leftLowerArm", (0.5, 0.0, 1.0), (2.0, 5.0, 0.6), 1),
    "boot": ("LowerLeg", (0.0, -0.6, 0.0), (1.3, 0.9, 1.3), 2),
    "mane": ("neck", (0.0, 0.6, -0.5), (0.5, 1.2, 1.0), 1),
    "saddle": ("spine", (0.0, 0.8, 0.0), (1.1, 0.4, 0.9), 1),
}


def dress_up(body: Body, rng: np.random.Generator, *, most: int = 4) -> Body:
    """Give a body some pieces that follow one part each; their weights are exact."""
    names = body.anatomy.names
    fitting = [
        name for name, (part, *_) in _WORN.items() if part in names or f"left{part}" in names
    ]
    chosen = rng.choice(fitting, size=int(rng.integers(0, most + 1)), replace=False)
    solids = [Solid(body.mesh.vertices, body.mesh.faces, body.weights)]
    for name in chosen:
        part, place, size, sides = _WORN[name]
        wearers = [part] if sides == 1 and part in names else [f"left{part}", f"right{part}"]
        if name in ("ear", "nose"):
            wearers = [part]
        scale = np.exp(rng.normal(0, 0.3, 3))
        shape = float(rng.uniform(0.15, 1.0)), float(rng.uniform(-0.3, 0.7))
        mirrors = (1.0, -1.0) if name == "ear" else (1.0,)
        for wearer in wearers:
            for sign in mirrors:
                where = np.array(place) * [sign, 1, 1]
                piece = _wear(body, names.index(wearer), where, np.array(size) * scale, shape)
                solids += [piece] if piece else []
    return assemble(body.family, body.kind, solids, body.joints)


def _wear(
    body: Body, part: int, place: np.ndarray, size: np.ndarray, form: tuple[float, float]
) -> Solid | None:
    """Put a solid beside the box around a part's own vertices."""
    own = body.mesh.vertices[body.weights[:, part] > 0.5]
    if len(own) < 4:
        return None
    low, high = np.percentile(own, [2, 98], axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-3)
    centre, reach = middle + place * half, np.minimum(half * size, 0.35)
    ends = centre + reach[1] * np.array([[0, -1.0, 0], [0, 1.0, 0]])
    share = Share((part,), (), 0.01)
    radii = (float(reach[0]), float(reach[2]))
    return place_solid(ends, radii, share, len(body.joints), form=form)

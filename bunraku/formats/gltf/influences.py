"""Which joints move each vertex of a vertex buffer, and how much; damage is repaired aloud."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from bunraku.errors import NOTE, WARNING, Code
from bunraku.formats.gltf.accessors import read_floats, read_integers
from bunraku.formats.gltf.document import Document

MOST_SETS = 8  # of four joints each, that move a vertex
Joints = Int[np.ndarray, "vertices influences"]
Weights = Float[np.ndarray, "vertices influences"]


def read_influences(
    document: Document, node: int, where: str, *, vertices: Float[np.ndarray, "vertices 3"]
) -> tuple[Joints, Weights, int]:
    """Read all sets of JOINTS and WEIGHTS of a primitive side by side.

    Args:
        document: the file.
        node: the node that shows the primitive; its skin numbers the joints.
        where: the primitive, as a JSON pointer.
        vertices: the primitive's positions, to repair what has no weight at all.

    Returns:
        joints as places in the skin's list and weights of sum 1, no columns if no skin moves it;
        and how many vertices had no weight that is a number.

    Raises:
        FormatError: if a joint is not in the skin, or arrays differ in length.
    """
    skin, sets = document.gltf.nodes[node].skin, _list_sets(document, where)
    if skin is None or not sets:
        if skin is not None:
            document.warn(
                where, "has a skin but no weights; it follows its node", code=Code.SKIN_WEIGHTS
            )
        return np.zeros((len(vertices), 0), np.int64), np.zeros((len(vertices), 0)), 0
    parts = [read_integers(document, joints, 4) for joints, _ in sets]
    shares = [read_floats(document, weights, 4) for _, weights in sets]
    if {len(part) for part in (*parts, *shares)} != {len(vertices)}:
        message = f"JOINTS and WEIGHTS must have one row for each of {len(vertices)} vertices"
        raise document.fault(f"{where}/attributes", message, code=Code.SKIN_WEIGHTS)
    joints, weights = np.concatenate(parts, axis=1), np.concatenate(shares, axis=1)
    count = len(document.gltf.skins[skin].joints)
    wrong = (joints >= count) & (weights != 0)
    if wrong.any():
        vertex = int(wrong.any(axis=1).argmax())
        message = f"vertex {vertex} uses joint {joints[wrong][0]} of a skin of {count}"
        raise document.fault(
            f"{where}/attributes/JOINTS_0", f"{message}; bind the mesh again", code=Code.SKIN_JOINTS
        )
    joints = np.where(joints < count, joints, 0)
    place = {node: place for place, node in enumerate(document.gltf.skins[skin].joints)}
    if len(place) < count:  # a node that is twice a joint: its last place stands for all
        joints = np.array([place[node] for node in document.gltf.skins[skin].joints])[joints]
    lost = int((~np.isfinite(weights)).all(axis=1).sum())
    weights = _clean_weights(document, where, weights)
    given = any(not document.gltf.accessors[shares].is_placeholder for _, shares in sets)
    level = WARNING if given else NOTE
    filled = _fill_gaps(document, where, joints, weights=weights, vertices=vertices, level=level)
    return *filled, lost


def _list_sets(document: Document, where: str) -> list[tuple[int, int]]:
    """List the accessors of JOINTS_0 and WEIGHTS_0, JOINTS_1 and WEIGHTS_1, ..."""
    _, _, mesh, _, primitive = where.split("/")
    names = document.gltf.meshes[int(mesh)].primitives[int(primitive)].attributes
    sets: list[tuple[int, int]] = []
    while f"JOINTS_{len(sets)}" in names and f"WEIGHTS_{len(sets)}" in names:
        sets.append((names[f"JOINTS_{len(sets)}"], names[f"WEIGHTS_{len(sets)}"]))
        if len(sets) > MOST_SETS:
            message = f"more than {4 * MOST_SETS} joints move a vertex; bind to fewer"
            raise document.fault(where, message, code=Code.LIMIT_TOTAL)
    if any(f"{name}_{len(sets)}" in names for name in ("JOINTS", "WEIGHTS")):
        document.warn(
            where,
            "JOINTS and WEIGHTS do not come in pairs; the odd one is ignored",
            code=Code.SKIN_WEIGHTS,
        )
    return sets


def _clean_weights(document: Document, where: str, weights: Weights) -> Weights:
    """Make weights positive and of sum 1, or 0 where nothing is left of them."""
    damaged = ~np.isfinite(weights) | (weights < 0)
    clean = np.where(damaged, 0.0, weights)
    total = clean.sum(axis=1)
    if damaged.any():
        count = damaged.any(axis=1).sum()
        document.warn(
            where,
            f"weights of {count} vertices were NaN or negative; repaired",
            code=Code.SKIN_WEIGHTS,
        )
    odd = (np.abs(total - 1) > 1e-2) & ~damaged.any(axis=1) & (total > 0)
    if odd.any():
        document.warn(
            where,
            f"weights of {odd.sum()} vertices do not sum to 1; normalised",
            code=Code.SKIN_WEIGHTS,
        )
    return clean / np.where(total > 0, total, 1.0)[:, None]


def _fill_gaps(
    document: Document,
    where: str,
    joints: Joints,
    *,
    weights: Weights,
    vertices: Float[np.ndarray, "vertices 3"],
    level: int,
) -> tuple[Joints, Weights]:
    """Give vertices without any weight those of the nearest vertex that has some."""
    bare: Bool[np.ndarray, " vertices"] = weights.sum(axis=1) == 0
    if not bare.any():
        return joints, weights
    document.warn(
        where,
        f"{bare.sum()} vertices without weights follow their neighbours",
        code=Code.SKIN_WEIGHTS,
        level=level,
    )
    joints, weights = joints.copy(), weights.copy()
    if bare.all():
        joints[:, 0], weights[:, 0] = 0, 1.0
        return joints, weights
    nearest = cKDTree(vertices[~bare]).query(vertices[bare])[1]
    joints[bare], weights[bare] = joints[~bare][nearest], weights[~bare][nearest]
    return joints, weights

"""Bones out of curves and motion: split where the motion bends (Transfer4D, Sec. 4.3).

Every candidate split is judged from moments that add up along a curve, so all of them cost one
batch of small singular value decompositions.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.curves import CurveSkeleton
from bunraku.meshes import sum_rows
from bunraku.rotations import nearest_rotation

Paths = Float[np.ndarray, "frames vertices 3"]
GAIN = 0.2  # least relative gain of a split (eps_split)
ROUNDS = 3  # of splitting each curve
MOST_BONES, FEWEST = 30, 10  # bones in all; vertices of a bone
FLOOR = 0.005  # of the diagonal: a bone whose surface errs less is whole
MERGING = 0.1  # least relative gain of keeping a bone apart from its parent
LEAST_NODES = 3  # of a bone


@dataclass(frozen=True, eq=False)
class Bones:
    """A tree of bones, parents first, each with its surface and the joint it turns about."""

    joints: Float[np.ndarray, "bones 3"]  # at rest: where the bone meets its parent
    tips: Float[np.ndarray, "bones 3"]  # the other end
    parents: Int[np.ndarray, " bones"]
    owners: Int[np.ndarray, " vertices"]  # bone of each vertex
    rings: Int[np.ndarray, " bones"]  # node of the curve skeleton at each joint


@dataclass(frozen=True)
class Piece:
    """A part of a curve that moves as one: its nodes with both ends, and those it owns."""

    path: tuple[int, ...]
    own: tuple[int, ...]  # their vertices are its surface; no node has two owners


@dataclass(frozen=True, eq=False)
class Moments:
    """Sums over vertices from which the best rigid motion and its error follow."""

    count: Float[np.ndarray, " *sets"]
    rest: Float[np.ndarray, "*sets 3"]
    rest_squared: Float[np.ndarray, " *sets"]
    moved: Float[np.ndarray, "*sets frames 3"]
    moved_squared: Float[np.ndarray, "*sets frames"]
    product: Float[np.ndarray, "*sets frames 3 3"]


def node_moments(
    rest: Float[np.ndarray, "vertices 3"],
    paths: Paths,
    owners: Int[np.ndarray, " vertices"],
    count: int,
) -> Moments:
    """Sum up the moments of the vertices of each node."""
    moved = np.ascontiguousarray(paths.transpose(1, 0, 2))
    each = Moments(
        np.ones(len(rest)),
        rest,
        (rest**2).sum(axis=1),
        moved,
        (moved**2).sum(axis=-1),
        np.einsum("vfa,vb->vfab", moved, rest),
    )
    return gather_moments(each, owners, count)


def gather_moments(moments: Moments, owners: Int[np.ndarray, " sets"], count: int) -> Moments:
    """Sum up the moments of sets that have the same owner."""
    return Moments(*(sum_rows(owners, part, count) for part in vars(moments).values()))


def sum_moments(moments: Moments, chosen: Int[np.ndarray, "sets nodes"]) -> Moments:
    """Add the moments of sets of nodes; -1 stands for no node."""
    present = (chosen >= 0).astype(np.float64)
    return Moments(
        *(np.einsum("sn,sn...->s...", present, part[chosen]) for part in vars(moments).values())
    )


def rigid_errors(moments: Moments) -> Float[np.ndarray, " sets"]:
    """Give RC, the squared error of each set under its best rigid motions, a frame (Eq. 8)."""
    count = np.maximum(moments.count, 1)[:, None]
    spread = moments.rest_squared - (moments.rest**2).sum(axis=-1) / count[:, 0]
    moved = moments.moved_squared - (moments.moved**2).sum(axis=-1) / count
    product = moments.product - (
        moments.moved[..., :, None] * moments.rest[:, None, None, :] / count[..., None, None]
    )
    values = np.linalg.svd(product, compute_uv=False)
    values[..., 2] *= np.sign(np.linalg.det(product))
    return np.maximum(spread[:, None] + moved - 2 * values.sum(axis=-1), 0.0).mean(axis=1)


def curves_of(skeleton: CurveSkeleton) -> list[list[int]]:
    """Cut a tree at terminals and junctions into curves, each a list of nodes with both ends."""
    count = len(skeleton.nodes)
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for first, second in skeleton.edges:
        neighbours[first].append(int(second))
        neighbours[second].append(int(first))
    ends = [node for node in range(count) if len(neighbours[node]) != 2]
    curves, done = [], set()
    for start in ends:
        for following in neighbours[start]:
            path = [start, following]
            while len(neighbours[path[-1]]) == 2:
                path.append(next(n for n in neighbours[path[-1]] if n != path[-2]))
            if (path[-1], path[-2]) not in done:
                done.add((path[0], path[1]))
                curves.append(path)
    return curves


def split_curves(
    skeleton: CurveSkeleton,
    rest: Float[np.ndarray, "vertices 3"],
    paths: Paths,
    *,
    gain: float = GAIN,
    floor: float = FLOOR,
) -> list[Piece]:
    """Split curves where two rigid motions explain them much better than one (Eqs. 8-9).

    Paper: splits until the gain is below .2, and leaves open who owns the shared node. We: also
    until the error is below a share of the diagonal, because noise alone keeps splitting; the node
    goes with the part behind it, a junction's with the heaviest of those that meet there.
    """
    moments = node_moments(rest, paths, skeleton.owners, len(skeleton.nodes))
    least = (floor * float(np.linalg.norm(np.ptp(rest, axis=0)))) ** 2
    waiting = [(piece, 0) for piece in whole_curves(skeleton)]
    whole: list[Piece] = []
    while waiting:
        piece, rounds = waiting.pop(0)
        full = len(waiting) + len(whole) + 1 >= MOST_BONES
        at = None if full or rounds >= ROUNDS else best_split(moments, piece.own, gain, least)
        if at is None:
            whole.append(piece)
            continue
        place = piece.path.index(piece.own[at])
        near = Piece(piece.path[: place + 1], piece.own[:at])
        waiting += [(near, rounds + 1), (Piece(piece.path[place:], piece.own[at:]), rounds + 1)]
    return whole


def whole_curves(skeleton: CurveSkeleton) -> list[Piece]:
    """Make a piece of each curve; junctions belong to the curve with most vertices."""
    curves = curves_of(skeleton)
    owned = np.bincount(skeleton.owners, minlength=len(skeleton.nodes))
    degree = np.bincount(skeleton.edges.ravel(), minlength=len(skeleton.nodes))
    size = [int(owned[curve[1:-1]].sum()) for curve in curves]
    taken: dict[int, int] = {}
    for index in np.argsort(size):  # the heaviest last
        for node in (curves[index][0], curves[index][-1]):
            taken[node] = int(index)
    return [
        Piece(
            tuple(curve),
            tuple(n for n in curve if degree[n] == 2 or taken.get(n) == index),
        )
        for index, curve in enumerate(curves)
    ]


def best_split(moments: Moments, own: tuple[int, ...], gain: float, least: float) -> int | None:
    """Find the place in a curve that splits it best (Eq. 9), if it gains enough."""
    places = range(LEAST_NODES - 1, len(own) - LEAST_NODES + 2)
    if not len(places):
        return None
    sets = np.full((1 + 2 * len(places), len(own)), -1)
    sets[0] = own
    for row, at in enumerate(places):
        sets[1 + 2 * row, :at] = own[:at]
        sets[2 + 2 * row, at:] = own[at:]
    sums = sum_moments(moments, sets)
    errors = rigid_errors(sums)
    if errors[0] <= least * max(sums.count[0], 1):
        return None
    both = errors[1::2] + errors[2::2]
    few = np.minimum(sums.count[1::2], sums.count[2::2]) < FEWEST
    both = np.where(few, np.inf, both)
    best = int(both.argmin())
    return places[best] if 1 - both[best] / errors[0] > gain else None


def make_bones(
    skeleton: CurveSkeleton, pieces: list[Piece], rest: Float[np.ndarray, "vertices 3"]
) -> Bones:
    """Hang bones on each other, from the one that carries the middle of the surface.

    A bone turns about the end at which it meets its parent; the first, about its middle node.
    """
    bone_of_node = np.full(len(skeleton.nodes), -1)
    for index, piece in enumerate(pieces):
        bone_of_node[list(piece.own)] = index
    sizes = np.bincount(bone_of_node[skeleton.owners], minlength=len(pieces))
    centre = rest.mean(axis=0)
    away = [np.linalg.norm(skeleton.nodes[list(p.path)] - centre, axis=1).min() for p in pieces]
    heavy = sizes >= 0.3 * sizes.max()
    first = int(np.where(heavy, away, np.inf).argmin())
    order, parents, starts = hang(pieces, first)
    joints, tips, rings = [], [], []
    for bone in order:
        path, start = list(pieces[bone].path), starts[bone]
        middle = path[int(np.linalg.norm(skeleton.nodes[path] - centre, axis=1).argmin())]
        ring = middle if start is None else start
        tip = path[-1] if start is None or start == path[0] else path[0]
        joints.append(skeleton.nodes[ring])
        tips.append(skeleton.nodes[tip])
        rings.append(ring)
    place = np.argsort(np.array(order))
    return Bones(
        np.array(joints),
        np.array(tips),
        np.array([-1 if p < 0 else place[p] for p in (parents[bone] for bone in order)], np.int64),
        place[bone_of_node[skeleton.owners]],
        np.array(rings, np.int64),
    )


def merge_bones(
    bones: Bones,
    rest: Float[np.ndarray, "vertices 3"],
    paths: Paths,
    *,
    gain: float = MERGING,
    floor: float = FLOOR,
) -> Bones:
    """Give bones that move as their parents do, and those with hardly any surface, to the parents.

    The most alike go first. The other side of splitting, which sees one curve at a time.
    """
    least = (floor * float(np.linalg.norm(np.ptp(rest, axis=0)))) ** 2
    first, owner = node_moments(rest, paths, bones.owners, len(bones.parents)), bones.owners
    while len(bones.parents) > 1:
        count = len(bones.parents)
        now = np.zeros(len(first.count), np.int64)
        now[owner] = bones.owners
        moments = gather_moments(first, now, count)
        single = np.column_stack([np.arange(count), np.full(count, -1)])
        paired = np.column_stack([np.arange(count), bones.parents])[1:]
        errors = rigid_errors(sum_moments(moments, np.concatenate([single, paired])))
        sizes = moments.count
        both = errors[1:count] + errors[bones.parents[1:]]
        together, size = errors[count:], sizes[1:] + sizes[bones.parents[1:]]
        apart = 1 - both / np.maximum(together, 1e-30)
        apart[together <= least * size] = -1.0
        apart[sizes[1:] < FEWEST] = -2.0
        child = 1 + int(apart.argmin())
        if apart[child - 1] >= gain and count <= MOST_BONES:
            return bones
        bones = without_bone(bones, child)
    return bones


def without_bone(bones: Bones, child: int) -> Bones:
    """Give a bone's surface and children to its parent."""
    parent = int(bones.parents[child])
    kept = np.delete(np.arange(len(bones.parents)), child)
    number = np.empty(len(bones.parents), np.int64)
    number[kept] = np.arange(len(kept))
    number[child] = number[parent]
    above = np.where(bones.parents == child, parent, bones.parents)[kept]
    return Bones(
        bones.joints[kept],
        bones.tips[kept],
        np.where(above < 0, -1, number[above]),
        number[bones.owners],
        bones.rings[kept],
    )


def hang(
    pieces: list[Piece], first: int
) -> tuple[list[int], dict[int, int], dict[int, int | None]]:
    """Order bones from the first outwards: order, parent, and node where each meets its parent."""
    meeting: dict[int, list[int]] = {}
    for index, piece in enumerate(pieces):
        for node in (piece.path[0], piece.path[-1]):
            meeting.setdefault(node, []).append(index)
    order, parents = [first], {first: -1}
    starts: dict[int, int | None] = {first: None}
    for bone in order:  # grows while it is read
        for node in (pieces[bone].path[0], pieces[bone].path[-1]):
            if node == starts[bone]:
                continue
            for other in meeting[node]:
                if other not in parents:
                    parents[other], starts[other] = bone, node
                    order.append(other)
    return order, parents, starts


def fit_rigid(
    rest: Float[np.ndarray, "vertices 3"],
    paths: Paths,
    weights: Float[np.ndarray, " vertices"],
) -> tuple[Float[np.ndarray, "frames 3 3"], Float[np.ndarray, "frames 3"]]:
    """Give the best rigid motion of weighted points in every frame (Kabsch)."""
    share = weights / max(float(weights.sum()), 1e-30)
    centre = share @ rest
    moved = np.einsum("v,fva->fa", share, paths)
    product = np.einsum("fva,vb->fab", paths - moved[:, None], share[:, None] * (rest - centre))
    rotations = nearest_rotation(product + 1e-12 * np.eye(3))
    return rotations, moved - rotations @ centre

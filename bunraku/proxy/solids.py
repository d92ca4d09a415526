"""Make one solid without needless holes and handles out of marked grid nodes."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.spatial import cKDTree

from bunraku.proxy.voxels import dilate, erode

MOST_PLUG = 500  # nodes, for gaps of two: what fills more than a tunnel is no plug
MOST_PIECES = 64  # loose pieces looked at, largest first


def solid_nodes(inside: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Make one solid: tie the pieces together, fill what is enclosed, plug small tunnels.

    Both the solid and what is around it hang together face to face, so that its border is one
    closed surface.
    """
    solid = fill(bridge(inside))
    for steps in (1, 2):
        solid = fill(plug_tunnels(solid, steps))
    return fill(largest_piece(solid))


def largest_piece(solid: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Drop all but the largest piece that hangs together face to face."""
    labels, count = ndimage.label(solid)
    if count <= 1:
        return solid
    sizes = np.bincount(labels.ravel())
    return labels == 1 + int(sizes[1:].argmax())


def fill(solid: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Fill cavities: what cannot be reached from the grid's corner without crossing a wall."""
    outside, _ = ndimage.label(~solid)
    return outside != outside[0, 0, 0]


def bridge(inside: Bool[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Tie loose pieces to the largest with one rod each, at their nearest nodes; drop far ones.

    One rod a piece makes no handle, where closing the gap could make many. A rod may be 1.5 times
    as long as the piece is wide, so that a floating hand is kept and a far speck is not.
    """
    labels, count = ndimage.label(inside)
    if count <= 1:
        return inside
    sizes = np.bincount(labels.ravel())[1:]
    order = np.argsort(-sizes, kind="stable")[:MOST_PIECES]
    rim = inside & ~erode(inside)
    members = {int(i): np.argwhere(rim & (labels == i + 1)) for i in order}
    solid, newest = labels == order[0] + 1, members.pop(int(order[0]))
    gaps = dict.fromkeys(members, (np.inf, newest[0], newest[0]))
    while gaps:
        tree = cKDTree(newest)
        gaps = {i: min(gap, _gap(tree, newest, members[i]), key=_length) for i, gap in gaps.items()}
        excess = {i: gap[0] / max(1.5 * np.cbrt(sizes[i]), 3.0) for i, gap in gaps.items()}
        nearest = min(excess, key=excess.__getitem__)
        if excess[nearest] > 1:
            break
        _, start, stop = gaps.pop(nearest)
        solid |= labels == nearest + 1
        _add_rod(solid, start, stop, np.cbrt(sizes[nearest]) / 4)
        newest = members[nearest]
    return solid


def _length(gap: tuple[float, np.ndarray, np.ndarray]) -> float:
    return gap[0]


def _gap(
    tree: cKDTree, nodes: Int[np.ndarray, "nodes 3"], piece: Int[np.ndarray, "members 3"]
) -> tuple[float, np.ndarray, np.ndarray]:
    """Find the shortest way from a piece to the nodes of a tree: length, start and stop."""
    distance, nearest = tree.query(piece)
    best = int(distance.argmin())
    return float(distance[best]), piece[best], nodes[nearest[best]]


def _add_rod(
    solid: Bool[np.ndarray, "x y z"],
    start: Int[np.ndarray, "3"],
    stop: Int[np.ndarray, "3"],
    radius: float,
) -> None:
    """Mark the nodes within `radius` of a straight line, no farther than its ends reach."""
    length = float(np.linalg.norm(stop - start))
    radius = float(np.clip(radius, 1.0, max(length / 2, 1.0)))
    low = np.floor(np.minimum(start, stop) - radius).astype(int)
    high = np.ceil(np.maximum(start, stop) + radius).astype(int) + 1
    nodes = low + np.indices(tuple(high - low)).reshape(3, -1).T
    along = np.clip((nodes - start) @ (stop - start) / max(length, 1e-9) ** 2, 0, 1)
    apart = np.linalg.norm(nodes - start - along[:, None] * (stop - start), axis=1)
    solid[tuple(nodes[apart <= radius].T)] = True


def plug_tunnels(solid: Bool[np.ndarray, "x y z"], steps: int) -> Bool[np.ndarray, "x y z"]:
    """Fill the gaps that closing by so many nodes would fill, but only where that removes handles.

    Gaps between limbs stay open: to fill them removes no handle.
    """
    if characteristic(solid) >= 1:
        return solid
    added = erode(dilate(solid, steps), steps) & ~solid
    pieces, count = ndimage.label(added, np.ones((3, 3, 3)))
    if not count:
        return solid
    gain = _lost_handles(solid, added, pieces, count)
    sizes = np.bincount(pieces.ravel(), minlength=count + 1)
    return solid | ((gain > 0.5) & (sizes < MOST_PLUG * steps**2 * gain))[pieces]


def characteristic(solid: Bool[np.ndarray, "x y z"]) -> float:
    """Count pieces - handles + cavities: 1 for a plain lump."""
    solid = np.pad(solid, 1)  # a solid may touch the grid's border
    _, low = _cubes_around(np.argwhere(solid & ~erode(solid)), solid.shape)
    return float(_SHARES[_corner_bits(solid, low)].sum())


def _cubes_around(
    nodes: Int[np.ndarray, "nodes 3"], shape: tuple[int, ...]
) -> tuple[Int[np.ndarray, " cubes"], Int[np.ndarray, "cubes 3"]]:
    """List the 2x2x2 cubes that touch some nodes: one (node, corner) of each, its lowest node."""
    around = (nodes[:, None] - _CORNERS).reshape(-1, 3)
    cubes, first = np.unique(np.ravel_multi_index(tuple(around.T), shape), return_index=True)
    return first, np.stack(np.unravel_index(cubes, shape), axis=1)


def _corner_bits(
    solid: Bool[np.ndarray, "x y z"], low: Int[np.ndarray, "cubes 3"]
) -> Int[np.ndarray, " cubes"]:
    """Code which of a cube's eight corners are marked as a number below 256."""
    corners = tuple((low[:, None] + _CORNERS).reshape(-1, 3).T)
    return solid[corners].reshape(-1, 8) @ (1 << np.arange(8))


def _lost_handles(
    solid: Bool[np.ndarray, "x y z"],
    added: Bool[np.ndarray, "x y z"],
    pieces: Int[np.ndarray, "x y z"],
    count: int,
) -> Float[np.ndarray, " pieces"]:
    """Give the rise of the Euler characteristic by each added piece; entry 0 is nobody's."""
    solid, added, pieces = np.pad(solid, 1), np.pad(added, 1), np.pad(pieces, 1)
    nodes = np.argwhere(added)
    owners = np.repeat(pieces[tuple(nodes.T)], 8)
    first, low = _cubes_around(nodes, solid.shape)
    rise = _SHARES[_corner_bits(solid | added, low)] - _SHARES[_corner_bits(solid, low)]
    return np.bincount(owners[first], rise, count + 1)


def cube_corners(shape: tuple[int, ...]) -> list[tuple[slice, ...]]:
    """Give the eight views of a grid whose equal indices are the corners of one 2x2x2 cube."""
    ends = [[slice(0, size - 1), slice(1, size)] for size in shape]
    return [(ends[0][i], ends[1][j], ends[2][k]) for i in (0, 1) for j in (0, 1) for k in (0, 1)]


def _characteristic_shares() -> Float[np.ndarray, "256"]:
    """Tabulate each 2x2x2 cube's share of the Euler characteristic of a 26-connected solid.

    With every node a voxel: corners - edges + faces - voxels around the middle of the cube.
    """
    cubes = (np.arange(256)[:, None] >> np.arange(8) & 1).astype(bool).reshape(256, 2, 2, 2)
    corner = cubes.any(axis=(1, 2, 3))
    edges = sum(cubes.any(axis=axes).sum(axis=1) for axes in ((1, 2), (1, 3), (2, 3)))
    faces = sum(cubes.any(axis=axis).sum(axis=(1, 2)) for axis in (1, 2, 3))
    return corner - edges / 2 + faces / 4 - cubes.sum(axis=(1, 2, 3)) / 8


_CORNERS = np.indices((2, 2, 2)).reshape(3, -1).T
_SHARES = _characteristic_shares()

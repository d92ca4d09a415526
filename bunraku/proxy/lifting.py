"""Carry what is known at a proxy's vertices to the full figure."""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from bunraku import graphs, meshes
from bunraku.proxy.building import Proxy

SEAM = 5e-4  # parts nearer than this share of the longest extent hang together
HIDDEN = 0.0075  # depth under the proxy, as a share of the longest extent, that hides a vertex
DUST = 1e-4  # share of the area below which a part is no accessory, only a scrap of a surface
BODY = 0.35  # share of the area above which a part is no accessory, but the body or its clothes


def lift(
    proxy: Proxy, values: Float[np.ndarray, "proxy_vertices *values"]
) -> Float[np.ndarray, "vertices *values"]:
    """Blend values at the proxy's vertices into every vertex of the figure."""
    count = len(proxy.corners)
    starts = np.arange(0, 3 * count + 1, 3)
    blend = csr_array(
        (proxy.barycentric.ravel(), proxy.corners.ravel(), starts), shape=(count, len(values))
    )
    return (blend @ values.reshape(len(values), -1)).reshape(count, *values.shape[1:])


def lift_weights(
    proxy: Proxy,
    weights: Float[np.ndarray, "proxy_vertices joints"],
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
) -> Float[np.ndarray, "vertices joints"]:
    """Carry skinning weights to the figure; accessories move as wholes.

    An eye, a hat, a buckle or a backpack gets one row of weights. What spans several joints (a
    shirt, a sleeve, a boot, long hair) keeps the weights of the skin below it, vertex by vertex.
    """
    if not len(faces):
        return lift(proxy, weights)
    part, areas = hanging_parts(vertices, faces)
    lifted = lift(proxy, weights)
    depth = np.linalg.norm(vertices - lift(proxy, proxy.mesh.vertices), axis=1)
    hidden = depth > HIDDEN * np.ptp(vertices, axis=0).max()
    lifted[hidden] = lifted[nearest_seen(vertices, faces, hidden)[hidden]]
    count = int(part.max()) + 1
    part_areas = np.bincount(part, areas, count)
    mean, spread = part_means(lifted, part, areas, count)
    share = part_areas / part_areas.sum()
    whole = moves_as_whole(mean, spread, share, part_extents(vertices, part, count))
    rigid = whole[part]
    lifted[rigid] = sharpen(mean)[part[rigid]]
    return lifted


def part_means(
    values: Float[np.ndarray, "vertices joints"],
    part: Int[np.ndarray, " vertices"],
    areas: Float[np.ndarray, " vertices"],
    count: int,
) -> tuple[Float[np.ndarray, "parts joints"], Float[np.ndarray, " parts"]]:
    """Average the weights of each part by area, and their distances from that average."""
    total = np.maximum(np.bincount(part, areas, count), 1e-300)
    shares = areas / total[part]
    mean = csr_array((shares, (part, np.arange(len(part)))), shape=(count, len(part))) @ values
    apart = np.zeros(len(part))
    for joint, middle in enumerate(mean.T):  # all joints at once would fill the memory
        apart += np.abs(values[:, joint] - middle[part])
    return mean, np.bincount(part, shares * apart / 2, count)


def nearest_seen(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    hidden: Bool[np.ndarray, " vertices"],
) -> Int[np.ndarray, " vertices"]:
    """Give each hidden vertex the nearest one, along the surface, that is not; others themselves.

    The end of an arm that is stuck into a jacket belongs to the arm, whatever skin is near it. A
    part that is hidden whole keeps its own.
    """
    nearest = np.arange(len(vertices))
    used, around = np.unique(faces[hidden[faces].any(axis=1)], return_inverse=True)
    if not len(used):
        return nearest
    welded, kept, welded_of = meshes.weld(vertices[used], around.reshape(-1, 3))
    below = np.ones(len(welded), bool)
    below[welded_of[~hidden[used]]] = False
    edges = graphs.mesh_edges(kept)
    lengths = np.maximum(graphs.edge_lengths(welded, edges), 1e-300)
    graph = graphs.adjacency(edges, lengths, len(welded))
    rim = np.unique(edges[~below[edges]])
    if not len(rim):
        return nearest
    _, _, sources = dijkstra(
        graph, directed=False, indices=rim, min_only=True, return_predecessors=True
    )
    someone = np.empty(len(welded), np.int64)
    someone[welded_of] = used
    seen = np.where(below & (sources >= 0), sources, np.arange(len(welded)))
    nearest[used] = np.where(hidden[used], someone[seen[welded_of]], used)
    return nearest


def hanging_parts(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Int[np.ndarray, " vertices"], Float[np.ndarray, " vertices"]]:
    """Number the parts of a figure, seams healed; give each vertex its part and its area."""
    welded, _, welded_of = meshes.weld(vertices, faces, tolerance=SEAM)
    part = meshes.connected_parts(welded_of[faces], len(welded))[welded_of]
    return part, meshes.vertex_areas(vertices, faces)


def part_extents(
    vertices: Float[np.ndarray, "vertices 3"], part: Int[np.ndarray, " vertices"], count: int
) -> Float[np.ndarray, " parts"]:
    """Measure each part's longest side, as a share of the figure's."""
    ordered = vertices[np.argsort(part, kind="stable")]
    starts = np.cumsum(np.bincount(part, minlength=count)) - np.bincount(part, minlength=count)
    low, high = np.minimum.reduceat(ordered, starts), np.maximum.reduceat(ordered, starts)
    return (high - low).max(axis=1) / np.ptp(vertices, axis=0).max()


def moves_as_whole(
    mean: Float[np.ndarray, "parts joints"],
    spread: Float[np.ndarray, " parts"],
    share: Float[np.ndarray, " parts"],
    extent: Float[np.ndarray, " parts"],
) -> Bool[np.ndarray, " parts"]:
    """Tell which parts are accessories: their weights hardly differ from vertex to vertex.

    A part that is small beside the zones in which weights change, or that one joint rules, may
    differ more: what differs is then how it was matched, not how it should move.

    Args:
        mean: area-weighted mean weights of each part.
        spread: mean distance of a part's weights from that mean; 0 all equal, 1 all different.
        share: of the figure's area.
        extent: longest side, as a share of the figure's.
    """
    ruled = (mean.max(axis=1) >= 0.7) | (extent <= 0.1)
    alike = (spread <= 0.1) | (ruled & (spread <= 0.3)) | ((extent <= 0.03) & (spread <= 0.45))
    return (share >= DUST) & (share <= BODY) & alike


def sharpen(mean: Float[np.ndarray, "parts joints"]) -> Float[np.ndarray, "parts joints"]:
    """Let the joint that rules a part rule it more: a hat on a head does not follow the neck."""
    cubed = mean**3
    return cubed / np.maximum(cubed.sum(axis=1, keepdims=True), 1e-300)

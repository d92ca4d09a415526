"""Bones from motion alone, without curves: two baselines of Transfer4D's Table 1.

Written from the papers' texts: clusters of rigid motion after Le and Deng 2012 and 2014, and
spectral clusters of trajectories after Zhang et al. 2013, then joined into a tree where they touch.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.cluster.vq import kmeans2
from scipy.linalg import eigh
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from bunraku.bones.splitting import FEWEST, Bones, fit_rigid
from bunraku.graphs import mesh_edges
from bunraku.meshes import farthest_points

Points = Float[np.ndarray, "vertices 3"]
Paths = Float[np.ndarray, "frames vertices 3"]
Owners = Int[np.ndarray, " vertices"]
ROUNDS = 5  # of assigning and fitting, after each split
SPREAD = 600  # trajectories that are clustered; the others go with their nearest


def cluster_motion(rest: Points, paths: Paths, count: int) -> Owners:
    """Cluster vertices that move as one rigid body (Le and Deng): split the worst, then k-means.

    The worst cluster is split where its trajectories leave its rigid motion in opposite ways.

    Args:
        rest: the surface where nothing has moved.
        paths: the same vertices in every frame.
        count: clusters to make, at most.
    """
    owners = np.zeros(len(rest), np.int64)
    for clusters in range(1, count):
        errors = motion_errors(rest, paths, owners, clusters)
        own = errors[np.arange(len(rest)), owners]
        enough = np.bincount(owners, minlength=clusters) >= 2 * FEWEST
        total = np.where(enough, np.bincount(owners, own, minlength=clusters), -1.0)
        worst = int(total.argmax())
        if total[worst] <= 0.0:
            break
        members = owners == worst
        owners[members] = np.where(opposes(rest[members], paths[:, members]), clusters, worst)
        for _ in range(ROUNDS):
            owners = motion_errors(rest, paths, owners, clusters + 1).argmin(axis=1)
    return _renumber(owners)


def motion_errors(
    rest: Points, paths: Paths, owners: Owners, count: int
) -> Float[np.ndarray, "vertices clusters"]:
    """Give each vertex's squared error under each cluster's best motion; infinite if empty."""
    errors = np.full((len(rest), count), np.inf)
    for cluster in np.unique(owners):
        rotations, shifts = fit_rigid(rest, paths, (owners == cluster).astype(float))
        moved = np.einsum("fac,vc->fva", rotations, rest) + shifts[:, None]
        errors[:, cluster] = ((paths - moved) ** 2).sum(axis=-1).mean(axis=0)
    return errors


def opposes(rest: Points, paths: Paths) -> Bool[np.ndarray, " vertices"]:
    """Tell the two halves of a cluster by the main direction in which they leave its motion."""
    rotations, shifts = fit_rigid(rest, paths, np.ones(len(rest)))
    left = paths - np.einsum("fac,vc->fva", rotations, rest) - shifts[:, None]
    flat = left.transpose(1, 0, 2).reshape(len(rest), -1)
    directions = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2]
    side = (flat - flat.mean(axis=0)) @ directions[0]
    return np.asarray(side > np.median(side))


def cluster_spectrally(rest: Points, paths: Paths, count: int) -> Owners:
    """Cluster trajectories that keep their distances (Zhang et al.): normalised cut, then k-means.

    Two vertices are alike if the distance between them hardly changes, and if they are near.

    Args:
        rest: the surface where nothing has moved.
        paths: the same vertices in every frame.
        count: clusters to make.
    """
    few = farthest_points(rest, min(SPREAD, len(rest)))
    count = min(count, len(few))
    chosen = paths[:, few]
    away = np.stack([np.linalg.norm(place[:, None] - place, axis=-1) for place in chosen])
    change = away.std(axis=0) / max(float(away.std(axis=0).mean()), 1e-12)
    near = away.mean(axis=0) / max(0.25 * float(away.mean()), 1e-12)
    alike = np.exp(-(change**2) - near**2)
    scale = 1.0 / np.sqrt(alike.sum(axis=1))
    highest = [len(few) - count, len(few) - 1]
    _, vectors = eigh(scale[:, None] * alike * scale, subset_by_index=highest)
    rows = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    _, labels = kmeans2(rows, count, minit="++", seed=np.random.default_rng(0))
    return _renumber(labels.astype(np.int64)[cKDTree(rest[few]).query(rest)[1]])


def join_clusters(rest: Points, faces: Int[np.ndarray, "faces 3"], owners: Owners) -> Bones:
    """Hang clusters on each other where they share the longest borders, else where they are near.

    A bone turns about the middle of the border with its parent; the first, which is the largest
    of those near the middle of the surface, about its own. Bones have no rings: these baselines
    know no curves.
    """
    count = int(owners.max()) + 1
    centres = np.stack([rest[owners == cluster].mean(axis=0) for cluster in range(count)])
    ends = mesh_edges(faces)
    across = ends[owners[ends[:, 0]] != owners[ends[:, 1]]]
    pairs = np.sort(owners[across], axis=1)
    ones = np.ones(len(pairs))
    border = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count)).toarray()
    border += border.T
    apart = np.linalg.norm(centres[:, None] - centres, axis=-1)
    cost = np.where(border > 0, 1.0 / (1.0 + border), 2.0 + apart / max(float(apart.max()), 1e-12))
    np.fill_diagonal(cost, 0.0)
    sizes = np.bincount(owners, minlength=count)
    away = np.linalg.norm(centres - rest.mean(axis=0), axis=1)
    first = int(np.where(sizes >= 0.3 * sizes.max(), away, np.inf).argmin())
    order, above = breadth_first_order(minimum_spanning_tree(cost), first, directed=False)
    place = np.empty(count, np.int64)
    place[order] = np.arange(count)
    parents = np.array([-1 if above[c] < 0 else place[above[c]] for c in order], np.int64)
    joints, tips = centres[order].copy(), centres[order].copy()
    for bone, cluster in enumerate(order):
        if parents[bone] >= 0:
            joints[bone] = _border(
                rest, across, owners, (int(cluster), int(above[cluster])), centres
            )
            tips[bone] = 2 * centres[cluster] - joints[bone]
    return Bones(joints, tips, parents, place[owners], np.full(count, -1, np.int64))


def _border(
    rest: Points,
    across: Int[np.ndarray, "edges 2"],
    owners: Owners,
    pair: tuple[int, int],
    centres: Float[np.ndarray, "clusters 3"],
) -> Float[np.ndarray, "3"]:
    """Give the middle of the border of two clusters, or the middle between them."""
    shared = np.isin(owners[across], pair).all(axis=1)
    ends = rest[across[shared]].reshape(-1, 3)
    middle: np.ndarray = ends.mean(axis=0) if len(ends) else centres[list(pair)].mean(axis=0)
    return middle


def _renumber(owners: Owners) -> Owners:
    """Number clusters from 0 without gaps."""
    return np.unique(owners, return_inverse=True)[1].astype(np.int64)

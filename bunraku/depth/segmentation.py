"""Which pixels of a depth video are the subject: as masked, or what stands before the scene.

A scene is told by pixels at the border of the picture. Its planes (floor, walls) and whatever never
moves are taken away; of what remains, the piece that moves most and is largest is the subject.
"""

import logging

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from bunraku.depth.projection import back_project
from bunraku.types import DepthVideo

logger = logging.getLogger(__name__)
Depth = Float[np.ndarray, "rows columns"]
Mask = Bool[np.ndarray, "rows columns"]
Masks = Bool[np.ndarray, "frames rows columns"]
JUMP = 0.12  # of the depth: neighbours farther apart are different things
FEWEST = 200  # pixels of a subject
SCENE = 0.25  # share of the border that is measured, from which on there is a scene


def find_subject(video: DepthVideo) -> Masks:
    """Give the subject's pixels in every frame; none where it is out of sight."""
    known = np.isfinite(video.depths) & (video.depths > 0)
    if video.masks is not None:
        return known & video.masks
    if not has_scene(known):
        return np.stack(
            [main_piece(depth, mask) for depth, mask in zip(video.depths, known, strict=True)]
        )
    before, moving = stand_out(video, known)
    return np.stack(
        [
            main_piece(depth, mask, prefer=moved)
            for depth, mask, moved in zip(video.depths, before, moving, strict=True)
        ]
    )


def has_scene(known: Masks) -> bool:
    """Tell whether the camera saw more than the subject: depth along the picture's border."""
    border = np.concatenate([known[:, 0], known[:, -1], known[:, :, 0], known[:, :, -1]], axis=1)
    return float(border.mean()) > SCENE


def main_piece(depth: Depth, mask: Mask, *, prefer: Mask | None = None) -> Mask:
    """Keep the largest connected piece of a mask; before a scene, the one that moves most.

    Args:
        depth: metres.
        mask: pixels that may be the subject's.
        prefer: pixels that move; None if there is no scene to tell the subject from.
    """
    whole = mask if prefer is None else mask & ~edge_pixels(depth, mask)
    labels, count = ndimage.label(whole, np.ones((3, 3)))
    sizes = np.bincount(labels.ravel(), minlength=count + 1).astype(np.float64)
    sizes[0] = 0.0
    scores = sizes.copy()
    if prefer is not None:
        moved = np.bincount(labels.ravel(), prefer.ravel(), minlength=count + 1)
        scores *= 0.02 + moved / np.maximum(sizes, 1)
    chosen = int(scores.argmax())
    if sizes[chosen] < FEWEST:
        return np.zeros_like(mask)
    piece = labels == chosen
    near = mask & (np.abs(depth - np.median(depth[piece])) < 2 * JUMP * depth)
    if prefer is not None:
        return np.asarray(piece | near & ndimage.binary_dilation(piece))
    large = sizes >= max(20.0, 0.01 * sizes[chosen])  # limbs that holes cut off belong to it
    return np.asarray(piece | near & large[labels])


def edge_pixels(depth: Depth, mask: Mask) -> Mask:
    """Mark the pixels of a mask at which the depth jumps to the next one, right or below."""
    edge = np.zeros_like(mask)
    for axis in (0, 1):
        after, before = np.delete(depth, 0, axis), np.delete(depth, -1, axis)
        both = np.delete(mask, 0, axis) & np.delete(mask, -1, axis)
        cut = both & (np.abs(after - before) > JUMP * np.minimum(after, before))
        edge |= np.pad(cut, [(0, int(axis == 0)), (0, int(axis == 1))])
    return edge


def stand_out(video: DepthVideo, known: Masks) -> tuple[Masks, Masks]:
    """Take planes away that reach the border; tell which pixels are nearer than they ever were.

    Returns:
        what stands before floor and walls, and what moves.
    """
    depths = np.where(known, video.depths, 0.0)
    spread = depths[:: max(1, len(depths) // 20)]
    farthest = np.percentile(spread, 90, axis=0) if len(spread) > 2 else spread.max(axis=0)
    moving = known & (depths < farthest - np.maximum(0.03, 0.02 * farthest))
    flat = scene_planes(depths[0], video.intrinsics)
    before = known.copy()
    for index, depth in enumerate(depths):
        points = back_project(depth, video.intrinsics)
        for normal, offset in flat:
            beyond = points @ normal - offset < 0.012 * depth + 0.01
            before[index] &= ~beyond
    logger.info("scene of %d planes taken away", len(flat))
    return before, moving


def scene_planes(
    depth: Depth, intrinsics: Float[np.ndarray, "3 3"], *, most: int = 4
) -> list[tuple[Float[np.ndarray, "3"], float]]:
    """Find the large planes of a scene that reach the border of the picture (RANSAC).

    Returns:
        unit normals towards the camera and offsets: n.p - offset is the height before the plane.
    """
    rng = np.random.default_rng(0)
    points = back_project(depth, intrinsics)
    rim = np.zeros(depth.shape, bool)
    margin = max(2, min(depth.shape) // 40)
    rim[:margin], rim[-margin:], rim[:, :margin], rim[:, -margin:] = True, True, True, True
    left, on_rim = points[depth > 0], rim[depth > 0]
    all_count, rim_count = len(left), max(1, int(on_rim.sum()))
    planes = []
    for _ in range(most):
        if len(left) < max(3 * FEWEST, 0.05 * all_count):
            break
        normal, offset = best_plane(left, rng)
        inside = np.abs(left @ normal - offset) < 0.012 * np.abs(left[:, 2])
        if inside.mean() * len(left) < 0.08 * all_count:
            break
        if on_rim[inside].sum() > 0.08 * rim_count:
            planes.append((normal, offset))
        left, on_rim = left[~inside], on_rim[~inside]
    return planes


def best_plane(
    points: Float[np.ndarray, "points 3"], rng: np.random.Generator, *, tries: int = 300
) -> tuple[Float[np.ndarray, "3"], float]:
    """Find the plane near most points, facing the origin, refined by least squares."""
    chosen = points[rng.integers(len(points), size=min(3000, len(points)))]
    corners = chosen[rng.integers(len(chosen), size=(tries, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.where(areas > 1e-9, normals / np.maximum(areas, 1e-9), np.nan)  # nan: no plane
    offsets = np.einsum("tc,tc->t", normals, corners[:, 0])
    away = np.abs(chosen @ normals.T - offsets) < 0.01 * np.abs(chosen[:, 2:])
    best = int(away.sum(axis=0).argmax())
    inliers = chosen[away[:, best]]
    if len(inliers) < 3:
        return normals[best], float(offsets[best])
    centre = inliers.mean(axis=0)
    normal = np.linalg.svd(inliers - centre, full_matrices=False)[2][2]
    normal *= -np.sign(normal @ centre) or 1.0
    return normal, float(normal @ centre)

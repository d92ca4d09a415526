"""One depth frame as a partial mesh: denoised, cut at depth edges, small scraps dropped."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.depth.projection import back_project
from bunraku.meshes import connected_parts, vertex_normals

Depth = Float[np.ndarray, "rows columns"]
Mask = Bool[np.ndarray, "rows columns"]
POINTS = 5000  # vertices that a frame's mesh should have, at most about
SMOOTHING = 0.012  # metres at diagonal 1: reach of the denoising filter
STEP = 0.02  # the same: depths farther apart are not averaged
EDGE = 0.025  # the same: longer edges are cut (the paper: .05 at diagonal 2)


@dataclass(frozen=True, eq=False)
class View:
    """The seen side of the subject in one frame, in the camera's frame (Y up, Z to the camera)."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    normals: Float[np.ndarray, "vertices 3"]
    depth: Depth  # of the subject's pixels, denoised; 0 elsewhere
    pixels: Int[np.ndarray, "vertices 2"]  # row and column of each vertex


def mesh_frame(
    depth: Depth, subject: Mask, intrinsics: Float[np.ndarray, "3 3"], diagonal: float
) -> View:
    """Mesh the subject of a depth frame, every few pixels (Transfer4D, Sec. 3).

    Paper: edges up to .05. We: up to a share of the subject's size, because cameras stand at any
    distance; and the depth is denoised first.

    Args:
        depth: metres, 0 where nothing was measured.
        subject: its pixels.
        intrinsics: pixels_from_camera.
        diagonal: of the subject's box, metres.
    """
    clean = denoise(np.where(subject, depth, 0.0).astype(np.float64), intrinsics, diagonal)
    stride = max(1, round(np.sqrt((clean > 0).sum() / POINTS)))
    rows, columns = (np.arange(stride // 2, side, stride) for side in clean.shape)
    points = back_project(clean, intrinsics)[rows[:, None], columns]
    footprint = stride * float(np.median(clean[clean > 0])) / intrinsics[0, 0]
    faces = grid_faces(points, max(EDGE * diagonal, 4 * footprint))
    kept = large_parts(faces, points.shape[0] * points.shape[1])
    numbers = np.cumsum(kept) - 1
    faces = numbers[faces[kept[faces[:, 0]]]]
    vertices = points.reshape(-1, 3)[kept]
    pixels = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)[kept]
    return View(vertices, faces, vertex_normals(vertices, faces), clean, pixels)


def denoise(depth: Depth, intrinsics: Float[np.ndarray, "3 3"], diagonal: float) -> Depth:
    """Average each depth with its neighbours on the same surface, along rows, then columns."""
    known = np.argwhere(depth > 0)
    if not len(known):
        return depth
    footprint = float(np.median(depth[depth > 0])) / intrinsics[0, 0]
    reach = int(np.clip(round(SMOOTHING * diagonal / footprint), 1, 5))
    low = np.maximum(known.min(axis=0) - reach, 0)
    high = known.max(axis=0) + reach + 1
    box = slice(low[0], high[0]), slice(low[1], high[1])
    clean = depth[box].astype(np.float32)
    for axis in (0, 1, 0, 1):
        clean = average_along(clean, axis, reach, STEP * diagonal)
    smooth = np.zeros(depth.shape, np.float32)  # kept for every frame
    smooth[box] = clean
    return smooth


def average_along(depth: Depth, axis: int, reach: int, step: float) -> Depth:
    """Average each known depth with those up to `reach` pixels away that differ by < `step`."""
    total, count = depth.copy(), (depth > 0).astype(depth.dtype)
    length = depth.shape[axis]
    for shift in range(1, min(reach, length - 1) + 1):
        ahead: list[slice] = [slice(None), slice(None)]
        behind = ahead.copy()
        ahead[axis], behind[axis] = slice(shift, None), slice(0, length - shift)
        near, far = depth[tuple(behind)], depth[tuple(ahead)]
        alike = (near > 0) & (far > 0) & (np.abs(near - far) < step)
        total[tuple(behind)] += far * alike
        total[tuple(ahead)] += near * alike
        count[tuple(behind)] += alike
        count[tuple(ahead)] += alike
    return total / np.maximum(count, 1)


def grid_faces(
    points: Float[np.ndarray, "rows columns 3"], longest: float
) -> Int[np.ndarray, "faces 3"]:
    """Make two triangles of every four neighbours that were seen and lie close together."""
    number = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    here, right, below, across = (
        block.ravel()
        for block in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    )
    faces = np.concatenate(
        [np.stack([here, below, right], axis=1), np.stack([right, below, across], axis=1)]
    )
    flat = points.reshape(-1, 3)
    seen = (flat[:, 2] < 0)[faces].all(axis=1)
    faces = faces[seen]
    corners = flat[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1)
    return faces[edges.max(axis=1, initial=0.0) < longest]


def large_parts(faces: Int[np.ndarray, "faces 3"], count: int) -> Bool[np.ndarray, " vertices"]:
    """Mark the vertices of parts that hold at least 1 % of all vertices with a face, and 20."""
    used = np.zeros(count, bool)
    used[faces] = True
    part = connected_parts(faces, count)
    sizes = np.bincount(part[used], minlength=int(part.max(initial=0)) + 1)
    return np.asarray(used & (sizes[part] >= max(20, 0.01 * used.sum())))

"""Deformation transfer between surfaces that only lie near one another ([SP] Sumner and Popovic).

The gate for everything learned: no rig, no training, triangles that are nearest correspond.

Reference:
    Sumner and Popovic 2004, "Deformation transfer for triangle meshes".
"""

import igl
import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from bunraku.evaluate.baselines import fit_box
from bunraku.meshes import face_normals, weld
from bunraku.types import Mesh

NORMAL = 0.1  # how much normals count beside places, in sizes
PULL = 1e-6  # towards the nearest vertex's offset, which settles where loose pieces go
Frames = Float[np.ndarray, "frames vertices 3"]
Moved = Float[np.ndarray, "frames moved 3"]


def nearest_offset(avatar: Mesh, poses: Frames, figure: Mesh) -> Moved:
    """Move each vertex as the avatar's nearest vertex moves, boxes laid over one another."""
    laid = fit_box(avatar.vertices, avatar.vertices, figure.vertices)
    nearest = KDTree(laid).query(figure.vertices)[1]
    scale = np.ptp(figure.vertices[:, 1]) / np.ptp(avatar.vertices[:, 1])
    moved: np.ndarray = figure.vertices + scale * (poses - avatar.vertices)[:, nearest]
    return moved


def transfer_deformation(
    avatar: Mesh,
    poses: Frames,
    figure: Mesh,
    *,
    corresponding: Int[np.ndarray, " faces"] | None = None,
) -> Moved:
    """Deform each triangle as the avatar's nearest triangle deforms; keep triangles together.

    Where the figure goes as a whole, and where its loose pieces go, is told by the offset of the
    nearest vertex, never by the truth.

    Args:
        avatar: at rest.
        poses: its vertices in each pose.
        figure: at rest.
        corresponding: the avatar's triangle of each of the figure's; the nearest without.
    """
    if corresponding is None:
        corresponding = nearest_triangles(avatar, figure)
    vertices, faces, place = weld(figure.vertices, figure.faces)
    kept = _kept_faces(figure.faces, place)
    gradient = igl.grad(np.ascontiguousarray(vertices), np.ascontiguousarray(faces))
    size = float(np.ptp(vertices, axis=0).max())
    areas = np.tile(igl.doublearea(vertices, faces) / 2, 3)
    areas = np.where(np.isfinite(areas), areas, 0.0)
    gradient.data[~np.isfinite(gradient.data)] = 0.0
    weighted = gradient.T @ sp.diags(areas)
    pull = PULL * sp.identity(len(vertices)) * areas.sum() / (3 * len(vertices) * size**2)
    solve = splu((weighted @ gradient + pull).tocsc()).solve
    near = nearest_offset(avatar, poses, Mesh(vertices, faces))
    moved = np.empty((len(poses), len(figure.vertices), 3))
    for frame, pose in enumerate(poses):
        maps = face_maps(avatar.vertices, pose, avatar.faces)[corresponding[kept]]
        wanted = maps.transpose(2, 0, 1).reshape(-1, 3)  # igl.grad: all x rows, then y, then z
        moved[frame] = solve(weighted @ wanted + pull @ near[frame])[place]
    return moved


def _kept_faces(
    faces: Int[np.ndarray, "faces 3"], place: Int[np.ndarray, " vertices"]
) -> Int[np.ndarray, " kept"]:
    """Tell which faces are left after welding, as `weld` drops those that collapse."""
    welded = place[faces]
    whole = (welded != np.roll(welded, 1, axis=1)).all(axis=1)
    return np.flatnonzero(whole)


def nearest_triangles(avatar: Mesh, figure: Mesh) -> Int[np.ndarray, " faces"]:
    """Give the avatar's triangle nearest in place and normal to each of the figure's."""
    laid = fit_box(avatar.vertices, avatar.vertices, figure.vertices)
    size = float(np.ptp(figure.vertices, axis=0).max())
    keys = []
    for vertices, faces in ((laid, avatar.faces), (figure.vertices, figure.faces)):
        normals = face_normals(vertices, faces)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
        keys.append(np.column_stack([vertices[faces].mean(axis=1), NORMAL * size * normals]))
    return np.asarray(KDTree(keys[0]).query(keys[1])[1])


def face_maps(
    rest: Float[np.ndarray, "vertices 3"],
    posed: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
) -> Float[np.ndarray, "faces 3 3"]:
    """Give the linear map of each triangle from rest to pose; its normal grows as its edges do."""
    return _face_frames(posed, faces) @ np.linalg.inv(_face_frames(rest, faces))


def _face_frames(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces 3 3"]:
    """Give two edges and the normal over the square root of its length, as columns."""
    a, b, c = (vertices[corner] for corner in faces.T)
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    flat = length[:, 0] < 1e-14
    frames = np.stack([b - a, c - a, normal / np.sqrt(np.maximum(length, 1e-20))], axis=-1)
    frames[flat] = np.eye(3)
    return frames

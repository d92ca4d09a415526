"""The pinhole camera, in our axes: Y up, the camera at the origin, looking along -Z.

Depth files look along +Z with Y down; here their points are turned half round about X, so that a
subject that stands before the camera stands upright and faces +Z.
"""

import numpy as np
from jaxtyping import Float


def pixel_rays(
    size: tuple[int, int], intrinsics: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "rows columns 3"]:
    """Give the point at depth 1 that each pixel sees: K^-1 [u, v, 1], in our axes.

    Args:
        size: width and height, pixels.
        intrinsics: pixels_from_camera; a pixel's number is its middle.
    """
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).astype(np.float64)
    rays: np.ndarray = pixels @ np.linalg.inv(intrinsics).T * [1.0, -1.0, -1.0]
    return rays


def back_project(
    depth: Float[np.ndarray, "rows columns"], intrinsics: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "rows columns 3"]:
    """Give the point that each pixel saw, p = D(u) K^-1 [u, 1] (Eq. 1), in metres.

    Reference:
        Maheshwari et al. 2023, "Transfer4D", Sec. 3.
    """
    return depth[..., None] * pixel_rays((depth.shape[1], depth.shape[0]), intrinsics)


def project_points(
    points: Float[np.ndarray, "*points 3"], intrinsics: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "*points 2"]:
    """Give the pixel (column, row) in which each point appears; points behind us are clamped."""
    away = np.maximum(-points[..., 2:], 1e-6)
    seen = np.concatenate([points[..., :1], -points[..., 1:2], away], axis=-1) @ intrinsics.T
    pixels: np.ndarray = seen[..., :2] / away
    return pixels

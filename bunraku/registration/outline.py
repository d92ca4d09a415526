"""Keep a surface within the subject's outline: where the camera saw background, nothing stands.

What sticks out is drawn back sideways only, at its own depth: a far leg may go behind the near one,
which nearest points in space would pull it onto.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt

from bunraku.depth.projection import project_points

STRIDE = 2  # pixels: a limb is many times wider
GAP = 1.0  # strides beside the outline that are noise
Points = Float[np.ndarray, "points 3"]
Nearest = Int[np.ndarray, "rows columns 2"]


def find_nearest_shown(depth: Float[np.ndarray, "all_rows all_columns"]) -> Nearest:
    """Give, for every STRIDE-th pixel, the row and column of the nearest that shows the subject.

    Its own, if none does: then nothing is known to stick out.
    """
    shown = depth[::STRIDE, ::STRIDE] > 0
    if not shown.any():
        return np.moveaxis(np.indices(shown.shape), 0, -1).astype(np.int64)
    nearest = distance_transform_edt(~shown, return_distances=False, return_indices=True)
    return np.moveaxis(nearest, 0, -1).astype(np.int64)


def find_strays(
    points: Points, nearest: Nearest, intrinsics: Float[np.ndarray, "3 3"]
) -> tuple[Int[np.ndarray, " strays"], Float[np.ndarray, "strays 3"]]:
    """Find points that the camera should see beside the subject, and the way back to its outline.

    Args:
        points: in the camera's frame, metres.
        nearest: of the frame.
        intrinsics: pixels_from_camera.

    Returns:
        which points, and their ways, across the camera's axis, metres.
    """
    pixels = np.rint(project_points(points, intrinsics)[:, ::-1] / STRIDE).astype(np.int64)
    cells = np.clip(pixels, 0, np.array(nearest.shape[:2]) - 1)
    off = nearest[cells[:, 0], cells[:, 1]] - cells
    stray = np.flatnonzero(np.hypot(off[:, 0], off[:, 1]) > GAP)
    metres = STRIDE * -points[stray, 2:] / np.diag(intrinsics)[:2]
    sideways = off[stray, ::-1] * metres * [1.0, -1.0]
    return stray, np.column_stack([sideways, np.zeros(len(stray))])

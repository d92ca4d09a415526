"""Which way is up in files that do not say, and the turn into our frame: Y up, facing +Z.

glTF is Y up by definition. OBJ is by custom, STL seldom is, PLY and OFF may be either, so the
figure itself is asked. Up is y or z, never x (left and right are along x wherever y or z is up):

1. the axis along which left mirrors right is not up;
2. a figure stands: seen along up, its centre of mass lies over what touches the ground;
3. people stand tall: of two ways of which both or neither are stable, the taller one counts; for
   figures about as long as tall, near the ground should be little (legs) of the shadow that they
   throw from above, while a cow put on its rump is broad below;
4. else the custom of the format decides.
"""

import logging

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError, cKDTree

from bunraku.errors import Code
from bunraku.formats.files import Location
from bunraku.meshes import face_normals
from bunraku.types import FormatError, Mesh

CUSTOM = {"obj": "y", "stl": "z"}
FACINGS = ("+x", "-x", "+y", "-y", "+z", "-z")
CONTACT = 0.03  # share of the longest extent that counts as touching the ground
LEGS = 0.15  # share of the height in which a standing figure has only feet or legs
CLEARLY_SYMMETRIC = 0.5  # one mirror's error, as a share of the next best one's
CLEARLY_NARROWER = 0.85
CLEARLY_TALLER = 1.15
UPRIGHT = 2.2  # no four-legged body is longer than this times its height
_CELLS = 32
_SAMPLES = 3000
_LINE = 1e-12  # area, of a figure of size 1, that points in a line span

logger = logging.getLogger(__name__)


def check_axes(path: Location, up: str | None, facing: str | None) -> None:
    """Raise a FormatError unless up and facing are axes that go together."""
    if up not in (None, "y", "z"):
        raise FormatError(path, "", f"cannot have {up!r} up; wanted y or z", code=Code.OPTION)
    if facing not in (None, *FACINGS):
        raise FormatError(
            path, "", f"cannot face {facing!r}; wanted one of {' '.join(FACINGS)}", code=Code.OPTION
        )
    if up and facing and up == facing[1]:
        raise FormatError(
            path, "", f"cannot face {facing} with {up} up; choose another axis", code=Code.OPTION
        )


def world_from_axes(up: str, facing: str | None = None) -> Float[np.ndarray, "3 3"]:
    """Build the rotation that brings `up` to +Y and `facing` to +Z.

    Args:
        up: y or z.
        facing: axis that the figure looks along; by custom +z if y is up, -y if z is.
    """
    facing = facing or ("+z" if up == "y" else "-y")
    forward = np.eye(3)["xyz".index(facing[1])] * (1.0 if facing[0] == "+" else -1.0)
    upward = np.eye(3)["xyz".index(up)]
    return np.stack([np.cross(upward, forward), upward, forward])


def guess_up(mesh: Mesh, kind: str) -> str:
    """Tell which axis of a figure is up, y or z; `kind` names its format."""
    points, masses = _sample(mesh)
    errors = [_mirror_error(points, axis) for axis in range(3)]
    for side, up in ((1, "z"), (2, "y")):
        others = min(error for axis, error in enumerate(errors) if axis != side)
        if errors[side] < CLEARLY_SYMMETRIC * others:
            return up
    stable = {axis: _stands(points, masses, "xyz".index(axis)) for axis in "yz"}
    if stable["y"] != stable["z"]:
        return "y" if stable["y"] else "z"
    _, y, z = np.ptp(points, axis=0)
    broad = {axis: _breadth_below(points, "xyz".index(axis)) for axis in "yz"}
    differ = min(broad.values()) < CLEARLY_NARROWER * max(broad.values())
    if stable["y"] and differ and max(y, z) < UPRIGHT * min(y, z):
        return min(broad, key=lambda axis: broad[axis])
    custom, taller = CUSTOM.get(kind), "y" if y > z else "z"
    needed = CLEARLY_TALLER if custom in (None, taller) else UPRIGHT
    if max(y, z) > needed * min(y, z):
        return taller
    return custom or "y"


def _sample(
    mesh: Mesh,
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, " points"]]:
    """Thin a mesh out to some thousand points, each with the area it stands for."""
    if len(mesh.faces):
        points = mesh.vertices[mesh.faces].mean(axis=1)
        masses = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    else:
        points, masses = mesh.vertices, np.ones(len(mesh.vertices))
    chosen = np.unique(np.linspace(0, len(points) - 1, _SAMPLES).astype(np.int64))
    middle = (points.max(axis=0) + points.min(axis=0)) / 2
    size = float(np.ptp(points, axis=0).max()) or 1.0
    return (points[chosen] - middle) / size, masses[chosen] / (masses[chosen].sum() or 1.0)


def _mirror_error(points: Float[np.ndarray, "points 3"], axis: int) -> float:
    """Measure how far points are from their own mirror image across the middle of an axis."""
    mirrored = points.copy()
    mirrored[:, axis] *= -1.0
    return float(cKDTree(points).query(mirrored)[0].mean())


def _stands(
    points: Float[np.ndarray, "points 3"], masses: Float[np.ndarray, " points"], up: int
) -> bool:
    """Tell whether the centre of mass lies over the hull of the points that touch the ground."""
    level = [axis for axis in range(3) if axis != up]
    ground = points[points[:, up] <= points[:, up].min() + CONTACT * np.ptp(points[:, up])][
        :, level
    ]
    spokes = ground - ground[0]
    longest = spokes[np.linalg.norm(spokes, axis=1).argmax()]
    if np.abs(spokes @ [longest[1], -longest[0]]).max() < _LINE:
        return False  # said at once; Qhull would take its time to say so
    try:
        equations = ConvexHull(ground).equations
    except (QhullError, ValueError):
        return False
    centre = masses @ points[:, level]
    return bool((equations[:, :2] @ centre + equations[:, 2] <= 0).all())


def _breadth_below(points: Float[np.ndarray, "points 3"], up: int) -> float:
    """Give the share of the shadow from above that lies under points near the ground."""
    level = [axis for axis in range(3) if axis != up]
    cells = np.floor(points[:, level] * _CELLS).astype(np.int64)
    heights = points[:, up] - points[:, up].min()
    low = heights <= LEGS * heights.max()
    return len(np.unique(cells[low], axis=0)) / len(np.unique(cells, axis=0))

"""The lens of a depth camera, out of the JSON files that recorders write.

{"width", "height", "fx", "fy", "cx", "cy", "depth_scale", "fps"}     ours
{..., "ppx", "ppy", "coeffs"}                                         RealSense
{"intrinsic_matrix": [fx, 0, 0, 0, fy, 0, cx, cy, 1], ...}            Open3D, column by column
{"K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]}                          ROS, OpenCV: row by row
{"CalibrationInformation": {"Cameras": [...]}}                        Azure Kinect
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Float

from bunraku.errors import Code, announce
from bunraku.formats.files import Location
from bunraku.types import FormatError

NAMES = {
    "fx": ("fx", "focal_x", "fl_x"),
    "fy": ("fy", "focal_y", "fl_y"),
    "cx": ("cx", "ppx", "principal_x"),
    "cy": ("cy", "ppy", "principal_y"),
    "width": ("width", "w", "image_width", "resolution_width"),
    "height": ("height", "h", "image_height", "resolution_height"),
    "depth_scale": ("depth_scale", "depth_units", "depth_factor", "scale"),
    "fps": ("fps", "frame_rate", "framerate"),
}
MATRICES = ("intrinsic_matrix", "camera_matrix", "K", "k", "intrinsics", "matrix")
NESTED = ("depth", "depth_intrinsics", "depth_camera", "intrinsics", "camera", "color")
WANTED = "wanted fx, fy, cx, cy in pixels, width, height, depth_scale (units a metre) and fps"
MOST = 1e9  # no number of a lens is as large, none that must be above 0 as small as 1 / MOST
PER_METRE, FPS = 1000.0, 30.0  # what recorders mean when they do not say


@dataclass(frozen=True)
class Lens:
    """A pinhole camera in pixels, and what its numbers and frames count."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: float = 0.0  # 0: not said
    height: float = 0.0
    depth_scale: float = PER_METRE  # units of a depth picture in one metre
    fps: float = FPS

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """Give K."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


def read_lens(path: Location, content: bytes) -> Lens:
    """Read the lens out of a recorder's JSON.

    Raises:
        FormatError: if the file is no JSON object, or tells no focal length or impossible ones.
    """
    try:
        told = msgspec.json.decode(content)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        message = f"is no JSON ({str(error)[:60]}); {WANTED}"
        raise FormatError(path, "", message, code=Code.DEPTH_INTRINSICS) from error
    if not isinstance(told, dict):
        raise FormatError(path, "", f"holds no JSON object; {WANTED}", code=Code.DEPTH_INTRINSICS)
    known = gather(told)
    missing = [name for name in ("fx", "fy", "cx", "cy") if name not in known]
    if missing:
        raise FormatError(
            path, "", f"tells no {' '.join(missing)}; {WANTED}", code=Code.DEPTH_INTRINSICS
        )
    for name, fallback in (("depth_scale", PER_METRE), ("fps", FPS)):
        if name not in known:
            message = f"tells no {name}; {fallback:g} is taken"
            announce(path, message, code=Code.DEPTH_INTRINSICS)
    bent = told.get("coeffs") or told.get("distortion_coefficients")
    if isinstance(bent, list) and any(bent):
        message = "the lens's distortion is left out; undistort for more accuracy"
        announce(path, message, code=Code.DEPTH_INTRINSICS)
    return check_lens(path, Lens(**known))


def gather(told: Mapping[str, Any], *, levels: int = 4) -> dict[str, float]:
    """Collect the numbers of a lens under our names, so many levels deep in a recorder's file."""
    known = azure_lens(told)
    for key in MATRICES:
        known |= numbers_of_matrix(told.get(key), by_column=key == "intrinsic_matrix")
    for name, spellings in NAMES.items():
        for spelling in spellings:
            value = told.get(spelling)
            if isinstance(value, int | float) and not isinstance(value, bool):
                known[name] = float(max(min(value, MOST), -MOST)) if value == value else np.nan
                break
    for key in NESTED:
        inner = told.get(key)
        if isinstance(inner, dict) and "fx" not in known and levels:
            known = gather(inner, levels=levels - 1) | known
    return known


def numbers_of_matrix(matrix: object, *, by_column: bool) -> dict[str, float]:
    """Read fx, fy, cx, cy off a 3 x 3 matrix, as nested lists or nine numbers in a row."""
    try:
        rows = np.asarray(matrix, np.float64).reshape(3, 3)
    except (TypeError, ValueError, OverflowError):
        return {}
    if by_column and rows[2, 2] == 1 and not rows[:2, 2].any():
        rows = rows.T
    return {"fx": rows[0, 0], "fy": rows[1, 1], "cx": rows[0, 2], "cy": rows[1, 2]}


def azure_lens(told: Mapping[str, Any]) -> dict[str, float]:
    """Read the depth camera of an Azure Kinect calibration, whose numbers are shares of a side."""
    cameras = told.get("CalibrationInformation", told)
    cameras = cameras.get("Cameras") if isinstance(cameras, dict) else None
    if not isinstance(cameras, list):
        return {}
    for camera in cameras:
        try:
            if "Depth" not in camera["Purpose"]:
                continue
            cx, cy, fx, fy = map(float, camera["Intrinsics"]["ModelParameters"][:4])
            width, height = float(camera["SensorWidth"]), float(camera["SensorHeight"])
        except (KeyError, TypeError, ValueError, OverflowError):
            continue
        return {
            **{"fx": fx * width, "fy": fy * height},
            **{"cx": cx * width - 0.5, "cy": cy * height - 0.5},
            **{"width": width, "height": height},
        }
    return {}


def check_lens(path: Location, lens: Lens) -> Lens:
    """Refuse what cannot be a lens; turn a depth scale in metres a unit into units a metre.

    Raises:
        FormatError: if a number is not finite, or not positive where it must be.
    """
    for name, value in vars(lens).items():
        if not abs(value) < MOST:
            message = f"is {value:g}; wanted a finite number below {MOST:g}"
            raise FormatError(path, f"/{name}", message, code=Code.DEPTH_INTRINSICS)
    for name in ("fx", "fy", "depth_scale", "fps", "width", "height"):
        value = getattr(lens, name)
        if value < 1 / MOST and (value or name not in ("width", "height")):
            raise FormatError(
                path,
                f"/{name}",
                f"is {value:g}; wanted a number above 0",
                code=Code.DEPTH_INTRINSICS,
            )
    if lens.depth_scale < 0.5:
        return replace(lens, depth_scale=1.0 / lens.depth_scale)
    return lens


def fit_lens(path: Location, lens: Lens, size: tuple[int, int]) -> Lens:
    """Bring a lens to the size of the frames: the same, or the same view in other pixels.

    Args:
        size: width and height of the frames.

    Raises:
        FormatError: if the lens is for frames of another shape, or its axis is out of sight.
    """
    width, height = size
    told = lens.width or width, lens.height or height
    across, along = width / told[0], height / told[1]
    if abs(across / along - 1) > 0.02:
        raise FormatError(
            path,
            "/width",
            f"is for {told[0]:g} x {told[1]:g} pixels, but the frames have {width} x {height}; "
            "give the lens of the depth stream",
            code=Code.DEPTH_INTRINSICS,
        )
    if told != (width, height):
        message = f"for {told[0]:g} x {told[1]:g} pixels; scaled to the frames'"
        announce(path, message, code=Code.DEPTH_INTRINSICS)
        lens = replace(
            lens,
            **{"fx": lens.fx * across, "fy": lens.fy * along},
            **{"cx": (lens.cx + 0.5) * across - 0.5, "cy": (lens.cy + 0.5) * along - 0.5},
        )
    if not (-0.5 * width <= lens.cx <= 1.5 * width and -0.5 * height <= lens.cy <= 1.5 * height):
        message = f"puts the middle of the view at {lens.cx:.0f}, {lens.cy:.0f}, far outside the"
        raise FormatError(
            path,
            "/cx",
            f"{message} {width} x {height} frames; correct cx and cy",
            code=Code.DEPTH_INTRINSICS,
        )
    if not 0.2 < lens.fx / max(width, height) < 10:
        message = f"is {lens.fx:g}, a view of"
        degrees = np.degrees(2 * np.arctan(width / 2 / lens.fx))
        raise FormatError(
            path,
            "/fx",
            f"{message} {degrees:.0f} degrees; wanted fx in pixels",
            code=Code.DEPTH_INTRINSICS,
        )
    return lens

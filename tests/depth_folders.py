"""Depth folders as a recorder leaves them, filmed from characters that tests make."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from bunraku.types import DepthVideo

LENS = {"width": 64, "height": 48, "fx": 60.0, "fy": 60.0, "cx": 31.5, "cy": 23.5}
OURS = LENS | {"depth_scale": 1000, "fps": 30}


def write_folder(folder: Path, depths: np.ndarray, lens: dict | None = OURS, numbers=None) -> Path:
    """Write frames (millimetres) and a lens."""
    folder.mkdir(exist_ok=True)
    for number, depth in zip(numbers or range(len(depths)), depths, strict=True):
        Image.fromarray(depth.astype(np.uint16)).save(folder / f"{number:04d}.png")
    if lens is not None:
        (folder / "intrinsics.json").write_text(json.dumps(lens))
    return folder


def ball(frames: int = 3, size: tuple[int, int] = (64, 48)) -> np.ndarray:
    """Make a disc 1.5 m away that moves to the right by two pixels a frame, in millimetres."""
    rows, columns = np.indices(size[::-1])
    near = [np.hypot(rows - 24, columns - 24 - 2 * frame) < 12 for frame in range(frames)]
    return np.where(near, 1500, 0).astype(np.uint16)


def save_video(folder: Path, video: DepthVideo) -> Path:
    """Write a video as a folder in millimetres."""
    matrix = video.intrinsics
    rows, columns = video.depths.shape[1:]
    rate = 1.0 / float(np.diff(video.times).mean())
    lens = {"width": columns, "height": rows, "depth_scale": 1000, "fps": rate}
    lens |= {"fx": matrix[0, 0], "fy": matrix[1, 1], "cx": matrix[0, 2], "cy": matrix[1, 2]}
    return write_folder(folder, np.rint(video.depths * 1000), lens)

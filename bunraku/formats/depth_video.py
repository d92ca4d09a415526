"""A folder of depth frames: NNNN.png in 16 bits, intrinsics.json, and mask/NNNN.png if known."""

import io
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Shaped, UInt16
from PIL import Image

from bunraku.errors import NOTE, Code, announce
from bunraku.formats.files import Location, read_bytes
from bunraku.formats.intrinsics import Lens, fit_lens, read_lens
from bunraku.types import DepthVideo, FormatError

LENS_FILES = ("intrinsics.json", "intrinsic.json", "camera.json", "calibration.json")
LARGEST_SIDE, MOST_PIXELS = 8192, 1 << 28  # of a frame; of a whole video
SIXTEEN_BITS = ("I;16", "I;16B", "I;16L", "I")
Picture = Shaped[np.ndarray, "rows columns"]


def is_depth_folder(path: Location) -> bool:
    """Tell whether a path is a folder that holds frames or a lens."""
    folder = Path(path)
    return folder.is_dir() and (bool(frame_files(folder)) or lens_file(folder) is not None)


def frame_files(folder: Path) -> dict[int, Path]:
    """List the frames by number, in order."""
    numbered: dict[int, Path] = {}
    for file in sorted(folder.glob("*.[pP][nN][gG]")):
        digits = re.findall(r"\d+", file.stem)
        if digits and not file.name.startswith("."):  # macOS leaves ._0000.png behind
            numbered.setdefault(int(digits[-1]), file)
    return dict(sorted(numbered.items()))


def lens_file(folder: Path) -> Path | None:
    """Find the file that describes the lens."""
    return next((folder / name for name in LENS_FILES if (folder / name).is_file()), None)


def read_depth(path: Location) -> DepthVideo:
    """Read a folder of depth frames, as a recorder left it.

    Missing numbers are pauses of as many frames. Where a frame measured nothing its depth is 0.

    Raises:
        FormatError: if it is no such folder, a frame is damaged, has another size or is no 16-bit
            picture of one channel, or the lens is not told or cannot be.
    """
    folder = Path(path)
    if not folder.is_dir():
        raise FormatError(
            path, "", "is no folder; give a folder of NNNN.png depth frames", code=Code.DEPTH_FRAMES
        )
    files = frame_files(folder)
    if not files:
        raise FormatError(
            path,
            "",
            "holds no NNNN.png depth frames; export them in 16 bits",
            code=Code.DEPTH_FRAMES,
        )
    found = lens_file(folder)
    if found is None:
        message = "holds no intrinsics.json; write one with fx, fy, cx, cy, width, height"
        raise FormatError(
            path, "", f"{message}, depth_scale (units a metre) and fps", code=Code.DEPTH_FRAMES
        )
    lens = read_lens(found, read_bytes(found))
    pictures = read_frames(files)
    lens = fit_lens(found, lens, (pictures.shape[2], pictures.shape[1]))
    return DepthVideo(
        os.fspath(path),
        frame_times(path, list(files), lens),
        (pictures / np.float32(lens.depth_scale)).astype(np.float32),
        lens.matrix,
        read_masks(folder / "mask", files, pictures.shape[1:]),
    )


def frame_times(path: Location, numbers: list[int], lens: Lens) -> Shaped[np.ndarray, " frames"]:
    """Give the time of each frame, in seconds from the first; gaps in numbering are pauses."""
    counted = np.array(numbers, np.float64)
    if len(counted) > 1:
        steps = np.diff(counted)
        counted /= max(float(np.median(steps)), 1.0)  # every second frame kept is no gap
        if np.ptp(steps):
            gap = int(np.flatnonzero(steps != np.median(steps))[0])
            message = f"frames are missing, first after {numbers[gap]}; they are taken as pauses"
            announce(path, message, code=Code.DEPTH_FRAMES, level=NOTE)
    return (counted - counted[0]) / lens.fps


def read_frames(files: dict[int, Path]) -> UInt16[np.ndarray, "frames rows columns"]:
    """Read frames of one size.

    Raises:
        FormatError: about the folder, naming the frame.
    """
    first = next(iter(files.values()))
    stack: np.ndarray | None = None
    for index, file in enumerate(files.values()):
        picture = read_picture(file, depth_of)
        if stack is None:
            if len(files) * picture.size > MOST_PIXELS:
                message = f"has {len(files)} frames of {picture.shape[1]} x {picture.shape[0]}"
                raise FormatError(
                    file.parent,
                    "",
                    f"{message}, too many at once; cut it shorter",
                    code=Code.DEPTH_FRAMES,
                )
            stack = np.zeros((len(files), *picture.shape), np.uint16)
        if picture.shape != stack.shape[1:]:
            sizes = f"{picture.shape[1]} x {picture.shape[0]} pixels"
            message = f"has {sizes}, {first.name} has {stack.shape[2]} x {stack.shape[1]}"
            where = f"frame {file.name}"
            raise FormatError(
                file.parent, where, f"{message}; record in one size", code=Code.DEPTH_FRAMES
            )
        stack[index] = picture
    assert stack is not None
    return stack


def read_picture(
    file: Path, values: Callable[[Path, Image.Image], Picture], *, limit: int = 1 << 28
) -> Picture:
    """Decode one picture.

    Raises:
        FormatError: about the folder, naming the frame.
    """
    content = read_bytes(file, limit=limit)
    where = f"frame {file.name}"
    try:
        with Image.open(io.BytesIO(content)) as image:
            if max(image.size) > LARGEST_SIDE:
                message = f"has {image.size[0]} x {image.size[1]} pixels; at most {LARGEST_SIDE}"
                raise FormatError(
                    file.parent, where, f"{message} a side are read", code=Code.DEPTH_FRAMES
                )
            return values(file, image)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, FormatError):
            raise
        message = "is damaged or no picture; export it again as 16-bit PNG"
        raise FormatError(file.parent, where, message, code=Code.DEPTH_FRAMES) from error


def depth_of(file: Path, image: Image.Image) -> Picture:
    """Give the numbers of a 16-bit picture of one channel."""
    if image.mode not in SIXTEEN_BITS:
        kinds = {"L": "8 bits", "P": "a palette of colours", "1": "1 bit", "LA": "8 bits and alpha"}
        what = kinds.get(image.mode, "colours")
        message = f"has {what}, wanted depth in 16 bits, one channel; export raw depth"
        raise FormatError(file.parent, f"frame {file.name}", message, code=Code.DEPTH_FRAMES)
    return np.clip(np.asarray(image), 0, 65535).astype(np.uint16)


def mask_of(file: Path, image: Image.Image) -> Picture:
    """Tell which pixels of a mask are set, whatever its depth and channels."""
    pixels = np.asarray(image.convert("RGBA") if image.mode == "P" else image)
    return np.asarray((pixels if pixels.ndim == 2 else pixels[..., :3].max(axis=-1)) > 0)


def read_masks(
    folder: Path, files: dict[int, Path], shape: Iterable[int]
) -> Bool[np.ndarray, "frames rows columns"] | None:
    """Read the subject's masks, if there are any.

    Raises:
        FormatError: if a mask is missing, damaged or of another size than its frame.
    """
    if not folder.is_dir():
        return None
    numbered, masks = frame_files(folder), []
    if not numbered:
        return None
    for number, file in files.items():
        if number not in numbered:
            message = f"has no mask for frame {file.name}; give one for each frame, or none"
            raise FormatError(folder, "", message, code=Code.DEPTH_FRAMES)
        mask = read_picture(numbered[number], mask_of)
        if mask.shape != tuple(shape):
            message = f"has {mask.shape[1]} x {mask.shape[0]} pixels, unlike its depth frame"
            where = f"frame {numbered[number].name}"
            raise FormatError(
                folder, where, f"{message}; export masks in the frames' size", code=Code.DEPTH_MASK
            )
        masks.append(mask)
    return np.stack(masks)

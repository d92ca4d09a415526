"""What is odd about a depth video before anybody looks for its subject."""

import numpy as np
from jaxtyping import Bool, Float

from bunraku.errors import Code, announce
from bunraku.formats.files import Location
from bunraku.types import DepthVideo, FormatError

FEWEST_PIXELS = 200  # measured in a frame: fewer show no subject
COARSE = 0.1  # metres between neighbouring depths from which a surface is a staircase
ROUGH = 0.05  # of the depth: neighbouring pixels of a surface are alike, those of noise are not
FLAT = 0.01  # of the depth: in a wall all depths are alike
APART = 0.2  # of its pixels: a subject that shares fewer with itself a frame later has jumped
FAR, NEAR = 20.0, 0.05  # metres: no subject is filmed from beyond, or from so near


def check_depth(path: Location, video: DepthVideo) -> None:
    """Announce what is odd about a depth video.

    Raises:
        FormatError: if nothing in it can move, or be told: too few pixels, a single frame, noise,
            a bare wall, another unit.
    """
    known = video.depths > 0
    counts = known.sum(axis=(1, 2))
    if counts.max() < FEWEST_PIXELS:
        message = f"measured at most {counts.max()} pixels a frame; wanted {FEWEST_PIXELS} or more"
        raise FormatError(path, "", f"{message}: record nearer", code=Code.DEPTH_SUBJECT)
    if len(counts) < 2:
        message = "has a single frame, which shows no motion; record a video"
        raise FormatError(path, "", message, code=Code.DEPTH_FRAMES)
    unseen = 0 if video.masks is None else int((~video.masks.any(axis=(1, 2))).sum())
    odd = (
        (int((counts == 0).sum()), "of the frames measured nothing", Code.DEPTH_SUBJECT),
        (unseen, "of the masks are empty: the subject is out of sight", Code.DEPTH_MASK),
    )
    for count, message, code in odd:
        if count:
            announce(path, f"{count} {message}", code=code)
    _check_values(path, video.depths[counts.argmax()], known[counts.argmax()])
    _check_motion(path, video, known if video.masks is None else known & video.masks)


def _check_values(
    path: Location,
    depth: Float[np.ndarray, "rows columns"],
    known: Bool[np.ndarray, "rows columns"],
) -> None:
    """Refuse depths that are those of no scene: of another unit, noise, or a bare wall."""
    values = depth[known].astype(np.float64)
    levels = np.unique(values)
    step = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    beside = known[:, 1:] & known[:, :-1]
    rough = np.median(np.abs(np.diff(depth, axis=1))[beside]) if beside.any() else 0.0
    near, far = np.percentile(values, [1, 99])
    if far < NEAR:
        message = f"depth reaches {far:.2g} m only; depth_scale is how many units make a metre"
        raise FormatError(path, "", message, code=Code.DEPTH_INTRINSICS)
    if far > FAR:
        message = f"depth reaches {far:.2g} m: is depth_scale right?"
        announce(path, message, code=Code.DEPTH_INTRINSICS)
    if step > COARSE:
        message = f"depth comes in steps of {step:.2g} m: record in millimetres"
        announce(path, message, code=Code.DEPTH_FRAMES)
    if rough > ROUGH * np.median(values):
        message = (
            "neighbouring pixels have nothing in common: this is noise, or no depth; export raw"
        )
        raise FormatError(path, "", message, code=Code.DEPTH_FRAMES)
    if far - near < FLAT * near and known.mean() > 0.9:
        message = "all depths are alike: a bare wall; record somebody before it"
        raise FormatError(path, "", message, code=Code.DEPTH_SUBJECT)


def _check_motion(
    path: Location, video: DepthVideo, seen: Bool[np.ndarray, "frames rows columns"]
) -> None:
    """Announce videos in which nothing moves, or everything jumps from frame to frame."""
    if all((depth == video.depths[0]).all() for depth in video.depths[1:]):
        announce(path, "all frames are the same: nothing moves", code=Code.DEPTH_SUBJECT)
    both = (seen[1:] & seen[:-1]).sum(axis=(1, 2))
    smaller = np.minimum(*(seen[frames].sum(axis=(1, 2)) for frames in (slice(1, None), slice(-1))))
    jumps = int((both < APART * smaller).sum())
    if 2 * jumps > len(both):
        message = f"{jumps} times the subject is elsewhere in the next frame: record more frames"
        announce(path, message, code=Code.DEPTH_SUBJECT)

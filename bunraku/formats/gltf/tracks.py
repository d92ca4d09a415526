"""Sample the channels of a clip: LINEAR, STEP and CUBICSPLINE, many channels at a time."""

from collections import defaultdict
from collections.abc import Container
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats.gltf.accessors import read_floats
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.schema import Channel, Sampler

WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
OTHER_PATHS = ("weights", "pointer")
RATE = 60.0  # samples a second where straight lines between keys would be wrong
SAME_TIME = 1e-5  # seconds between keys that count as one
LONGEST = 1e6  # seconds

Times = Float[np.ndarray, " frames"]
Values = Float[np.ndarray, "frames width"]


@dataclass(frozen=True, eq=False)
class Track:
    """The keys of one property of one node."""

    node: int
    path: str
    interpolation: str
    times: Times
    values: Float[np.ndarray, "keys width"]  # CUBICSPLINE: three rows a key
    is_constant: bool

    @property
    def is_straight(self) -> bool:
        """Tell whether lines between any samples that include its keys are exact."""
        return self.is_constant or self.interpolation == "LINEAR"


def read_tracks(document: Document, animation: int, nodes: Container[int]) -> list[Track]:
    """Read the channels of a clip that move any of these nodes.

    Raises:
        FormatError: if times do not rise, values are NaN or their number is wrong.
    """
    clip, times, tracks = document.gltf.animations[animation], {}, []
    seen: set[tuple[int, str]] = set()
    for index, channel in enumerate(clip.channels):
        key = channel.target.node, channel.target.path
        if key[1] not in (*WIDTHS, *OTHER_PATHS):
            document.warn(
                f"/animations/{animation}/channels/{index}",
                f"unknown path {key[1][:20]!r}",
                code=Code.CLIP_CHANNEL,
            )
        if key[0] is None or key[0] not in nodes or key[1] not in WIDTHS:
            continue
        where, sampler = f"/animations/{animation}/channels/{index}", clip.samplers[channel.sampler]
        if key in seen:
            document.warn(
                where,
                "moves what another channel moves already; ignored",
                code=Code.CLIP_CHANNEL,
            )
            continue
        seen.add((key[0], key[1]))
        if sampler.input not in times:
            times[sampler.input] = _read_times(document, sampler.input)
        tracks.append(_read_track(document, channel, sampler, *times[sampler.input]))
    return tracks


def _read_times(document: Document, accessor: int) -> tuple[Times, Bool[np.ndarray, " keys"]]:
    """Read key times, and which keys count: of several at one time the last."""
    times, where = read_floats(document, accessor, 1)[:, 0], f"/accessors/{accessor}"
    if not np.isfinite(times).all() or (np.diff(times) < 0).any():
        raise document.fault(
            where,
            "key times must be numbers that rise; export the clip again",
            code=Code.CLIP_TIMES,
        )
    if np.abs(times).max() > LONGEST:
        raise document.fault(
            where,
            f"key time {times[-1]:.3g} s; clips end before {LONGEST:.0e} s",
            code=Code.CLIP_TIMES,
        )
    if times[0] < 0:
        document.warn(where, f"key times begin before 0, at {times[0]:.4g} s", code=Code.CLIP_TIMES)
    if len(times) > limits.FRAMES:
        raise document.fault(
            where, f"{len(times)} keys; at most {limits.FRAMES} are read", code=Code.LIMIT_FRAMES
        )
    counts = np.append(np.diff(times) > 0, True)
    if not counts.all():
        message = f"{(~counts).sum()} keys have the time of the next one; they are left out"
        document.warn(where, message, code=Code.CLIP_TIMES)
    return times[counts], counts


def _read_track(
    document: Document,
    channel: Channel,
    sampler: Sampler,
    times: Times,
    counts: Bool[np.ndarray, " keys"],
) -> Track:
    """Read the values at the keys that count."""
    path, node = channel.target.path, channel.target.node
    assert node is not None
    where = f"/accessors/{sampler.output}"
    values = read_floats(document, sampler.output, WIDTHS[path])
    is_spline = sampler.interpolation == "CUBICSPLINE"
    if len(values) != len(counts) * (3 if is_spline else 1):
        message = f"{len(values)} values for {len(counts)} key times ({sampler.interpolation})"
        raise document.fault(where, f"{message}; export the clip again", code=Code.CLIP_VALUES)
    if not np.isfinite(values).all():
        raise document.fault(
            where,
            "animation values are NaN or infinite; export the clip again",
            code=Code.CLIP_VALUES,
        )
    values = values[np.repeat(counts, 3 if is_spline else 1)]
    keys = values[1::3] if is_spline else values
    if path == "rotation":
        lengths = np.einsum("kc,kc->k", keys, keys)
        if lengths.min() < 1e-12:
            raise document.fault(
                where, "a key is a zero quaternion; export the clip again", code=Code.CLIP_VALUES
            )
        if not 0.98 < lengths.min() <= lengths.max() < 1.02:
            document.warn(
                where,
                "rotations were not unit quaternions and were normalised",
                code=Code.CLIP_VALUES,
            )
    is_constant = _is_constant(values, sampler.interpolation)
    return Track(node, path, sampler.interpolation, times, values, is_constant)


def _is_constant(values: Float[np.ndarray, "rows width"], interpolation: str) -> bool:
    """Tell whether keys do not differ; exporters' constants come as STEP, with rounding noise."""
    if interpolation == "LINEAR":
        return bool((values == values[0]).all())
    if interpolation == "STEP":
        return float(np.ptp(values, axis=0).max()) <= 1e-4 * float(np.abs(values).max())
    arriving, keys, leaving = values[0::3], values[1::3], values[2::3]
    return bool((keys == keys[0]).all()) and not arriving.any() and not leaving.any()


def choose_times(document: Document, animation: int, tracks: list[Track], *, dense: bool) -> Times:
    """Give the times at which to sample a clip: those of all keys, from the first to the last.

    Args:
        document: the file.
        animation: the clip, for the message.
        tracks: its channels.
        dense: sample 60 times a second besides.

    Raises:
        FormatError: if the clip is too long for that.
    """
    ends = [track.times[[0, -1]] for track in tracks]
    moving = [track.times for track in tracks if not track.is_constant]
    times = np.unique(np.concatenate(ends + list({id(keys): keys for keys in moving}.values())))
    if dense or not all(track.is_straight for track in tracks):
        count = (times[-1] - times[0]) * RATE
        if count > limits.FRAMES:
            message = f"clip lasts {times[-1] - times[0]:.4g} s, too long to sample"
            raise document.fault(f"/animations/{animation}", message, code=Code.LIMIT_FRAMES)
        grid = times[0] + np.arange(int(count) + 1) / RATE
        times = np.unique(np.concatenate([times, grid[grid < times[-1]]]))
    return times[np.concatenate([[True], np.diff(times) > SAME_TIME])]


def sample_tracks(tracks: list[Track], times: Times) -> dict[tuple[int, str], Values]:
    """Evaluate every track at the same times; before its first and after its last key it rests."""
    groups: dict[tuple[int, str, str], list[Track]] = defaultdict(list)
    samples: dict[tuple[int, str], Values] = {}
    for track in tracks:
        if track.is_constant:
            key = track.values[1 if track.interpolation == "CUBICSPLINE" else 0]
            samples[track.node, track.path] = np.tile(key, (len(times), 1))
        else:
            groups[id(track.times), track.interpolation, track.path].append(track)
    for (_, interpolation, path), group in groups.items():
        keys = np.stack([track.values for track in group], axis=1)
        sampled = _interpolate(group[0].times, keys, times, kind=(interpolation, path))
        for place, track in enumerate(group):
            samples[track.node, path] = sampled[:, place]
    return samples


def _interpolate(
    keys: Float[np.ndarray, " keys"],
    values: Float[np.ndarray, "rows tracks width"],
    times: Times,
    *,
    kind: tuple[str, str],
) -> Float[np.ndarray, "frames tracks width"]:
    """Evaluate tracks with common key times; `kind` is the interpolation and the path."""
    interpolation, path = kind
    if interpolation == "LINEAR" and len(keys) == len(times) and (keys == times).all():
        return values
    before = np.clip(np.searchsorted(keys, times, side="right") - 1, 0, len(keys) - 1)
    after = np.minimum(before + 1, len(keys) - 1)
    span = keys[after] - keys[before]
    share = np.clip((times - keys[before]) / np.where(span > 0, span, 1.0), 0.0, 1.0)
    share = np.where(span > 0, share, 0.0)[:, None, None]
    if interpolation == "STEP":
        return values[before]
    if interpolation == "CUBICSPLINE":
        return _spline(values.reshape(len(keys), 3, *values.shape[1:]), before, share, span=span)
    if path == "rotation":
        return _slerp(values[before], values[after], share)
    return values[before] * (1 - share) + values[after] * share


def _spline(
    keys: Float[np.ndarray, "keys 3 tracks width"],
    before: np.ndarray,
    share: Float[np.ndarray, "frames 1 1"],
    *,
    span: Float[np.ndarray, " frames"],
) -> Float[np.ndarray, "frames tracks width"]:
    """Hermite curve through the keys' values with their tangents (specification, appendix C)."""
    after = np.minimum(before + 1, len(keys) - 1)
    square, cube, length = share**2, share**3, span[:, None, None]
    start = (2 * cube - 3 * square + 1) * keys[before, 1]
    leaving = (cube - 2 * square + share) * length * keys[before, 2]
    end = (3 * square - 2 * cube) * keys[after, 1]
    arriving = (cube - square) * length * keys[after, 0]
    return start + leaving + end + arriving


def _slerp(
    start: Float[np.ndarray, "frames tracks 4"],
    end: Float[np.ndarray, "frames tracks 4"],
    share: Float[np.ndarray, "frames 1 1"],
) -> Float[np.ndarray, "frames tracks 4"]:
    """Turn from start to end the shorter way, at constant speed."""
    first, last = Rotation.from_quat(start.reshape(-1, 4)), Rotation.from_quat(end.reshape(-1, 4))
    turn = (first.inv() * last).as_rotvec().reshape((*start.shape[:2], 3)) * share
    return (first * Rotation.from_rotvec(turn.reshape(-1, 3))).as_quat().reshape(start.shape)

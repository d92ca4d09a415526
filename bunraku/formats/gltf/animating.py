"""Put clips into a draft: straight lines between keys, and only what moves."""

from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from bunraku.formats.gltf.draft import Draft
from bunraku.rotations import decompose_transforms, matrices_to_quaternions
from bunraku.types import Clip, Skeleton

STILL = (
    1e-7  # changes of a translation (of the skeleton's size), rotation or scale that count as none
)
PATHS = {"translation": "VEC3", "rotation": "VEC4", "scale": "VEC3"}
Tracks = Float[np.ndarray, "frames joints width"]


def add_clip(draft: Draft, clip: Clip, skeleton: Skeleton, *, joints: list[int]) -> None:
    """Add a clip as an animation of the joints' nodes.

    A channel that never leaves the node's own value is left out; one that is constant elsewhere
    has two keys. Times begin at 0 or later, as glTF wants.
    """
    frames = _rising(clip.times)
    times = (clip.times[frames] - min(clip.times[0], 0.0)).astype(np.float32)
    moving, still = _split_tracks(clip, skeleton, frames)
    animation: dict[str, Any] = {"name": clip.name, "channels": [], "samplers": []}
    ends = np.unique([0, len(times) - 1])
    for keys, group in ((slice(None), moving), (ends, still)):
        if not group:
            continue
        source = draft.add_array(times[keys, None], "SCALAR")
        draft.add_bounds(source, times[keys])
        for path, kind in PATHS.items():
            chosen = [(joint, values[keys]) for joint, name, values in group if name == path]
            if not chosen:
                continue
            outputs = draft.add_arrays([values for _, values in chosen], kind)
            for (joint, _), output in zip(chosen, outputs, strict=True):
                target = {"node": joints[joint], "path": path}
                sampler = len(animation["samplers"])
                animation["channels"].append({"sampler": sampler, "target": target})
                animation["samplers"].append({"input": source, "output": output})
    draft.append("animations", animation)


def _rising(times: Float[np.ndarray, " frames"]) -> Shaped[np.ndarray, "..."]:
    """Choose the frames whose times still differ in float32."""
    single = (times - min(times[0], 0.0)).astype(np.float32)
    return np.flatnonzero(np.concatenate([[True], np.diff(np.maximum.accumulate(single)) > 0]))


def _split_tracks(
    clip: Clip, skeleton: Skeleton, frames: Shaped[np.ndarray, "..."]
) -> tuple[list[tuple[int, str, Any]], list[tuple[int, str, Any]]]:
    """Sort a clip's tracks into those that move and those that stand still, away from rest."""
    translations, rotations, scales = decompose_transforms(skeleton.rest)
    size = max(float(np.abs(translations).max()), 1e-30)
    quaternions = _continuous(clip.rotations[frames])
    tracks = (
        ("translation", clip.translations[frames], translations, size),
        ("rotation", quaternions, matrices_to_quaternions(rotations), 1.0),
        ("scale", clip.scales[frames], scales, 1.0),
    )
    moving: list[tuple[int, str, Any]] = []
    still: list[tuple[int, str, Any]] = []
    for path, values, rest, unit in tracks:
        for joint in range(values.shape[1]):
            track = values[:, joint].astype(np.float32)
            if np.ptp(values[:, joint], axis=0).max() > STILL * unit:
                moving.append((joint, path, track))
            elif not _is_rest(values[0, joint], rest[joint], path, STILL * unit):
                still.append((joint, path, track))
    if not moving and not still:
        still.append((0, "rotation", quaternions[:, 0].astype(np.float32)))
    return moving, still


def _is_rest(
    value: Float[np.ndarray, " width"], rest: Float[np.ndarray, " width"], path: str, limit: float
) -> bool:
    opposite = -1.0 if path == "rotation" and value @ rest < 0 else 1.0
    return bool(np.abs(opposite * value - rest).max() <= limit)


def _continuous(
    quaternions: Float[np.ndarray, "frames joints 4"],
) -> Float[np.ndarray, "frames joints 4"]:
    """Choose the sign of each quaternion that is nearer to the one before it."""
    flips = np.einsum("fjc,fjc->fj", quaternions[1:], quaternions[:-1]) < 0
    signs = np.cumprod(np.where(flips, -1.0, 1.0), axis=0)
    return quaternions * np.concatenate([np.ones_like(quaternions[:1, :, 0]), signs])[..., None]

"""What a camera saw and what was followed in it, kept small, to be shown beside a result."""

import io
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from bunraku.routes.from_depth import Capture

PERFORMER, FOOTAGE = "-performer.glb", "-film.npz"  # ends of the names of files beside a result
SEEN, FOLLOWED, ROWS = 2000, 500, 120  # points of a frame; rows of its picture, at most


@dataclass(frozen=True, eq=False)
class Footage:
    """A depth video in the performer's own frame and metres."""

    times: Float[np.ndarray, " frames"]
    pictures: UInt8[np.ndarray, "frames rows columns"]  # of depth: the nearer the brighter
    seen: Float32[np.ndarray, "frames seen 3"]  # points that the camera measured
    followed: Float32[np.ndarray, "frames followed 3"]  # points of the surface that was followed
    visible: Bool[np.ndarray, "frames followed"]  # which of those the camera saw

    def frame(self, time: float) -> int:
        """Number the frame that is shown at a time."""
        return min(int(np.searchsorted(self.times, time - 1e-9)), len(self.times) - 1)


def make_footage(capture: Capture) -> Footage:
    """Choose a few points of every frame, the same ones of the followed surface."""
    track, step = capture.track, max(1, -(-capture.views[0].depth.shape[0] // ROWS))
    seen = [view.vertices[_spread(len(view.vertices), SEEN)] for view in capture.views]
    few = np.unique(_spread(track.places.shape[1], FOLLOWED))
    return Footage(
        capture.times,
        _brighten(np.stack([view.depth[::step, ::step] for view in capture.views])),
        (np.stack(seen) + capture.eye).astype(np.float32),
        (track.places[:, few] + capture.eye).astype(np.float32),
        track.visible[:, few],
    )


def _spread(count: int, wanted: int) -> np.ndarray:
    """Number so many things spread evenly over all of them; few come more than once."""
    return np.linspace(0, count - 1, wanted).astype(np.int64)


def _brighten(
    depths: Float[np.ndarray, "frames rows columns"],
) -> UInt8[np.ndarray, "frames rows columns"]:
    """Make pictures of depths: near is white, far is grey, nothing is black."""
    known = depths > 0
    near, far = np.percentile(depths[known], [1, 99])
    share = np.clip((far - depths) / max(far - near, 1e-9), 0.0, 1.0)
    return np.where(known, 60 + 195 * share, 0).astype(np.uint8)


def encode_footage(footage: Footage) -> bytes:
    """Give the bytes of a file."""
    content = io.BytesIO()
    np.savez_compressed(content, **vars(footage))
    return content.getvalue()


def decode_footage(content: bytes) -> Footage:
    """Read what `encode_footage` gave."""
    with np.load(io.BytesIO(content)) as stored:
        return Footage(**stored)

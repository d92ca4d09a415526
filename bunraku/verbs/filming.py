"""Depth videos as performances: capture who was filmed, and let it move a figure."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from bunraku.bones.performer import CLIP
from bunraku.errors import Code, announce, collecting_doubts
from bunraku.evaluate.report import report_capture
from bunraku.formats import read_depth
from bunraku.formats.depth_checks import check_depth
from bunraku.formats.files import Location
from bunraku.routes.from_depth import Capture, DepthTransfer, animate_from_depth, capture_performer
from bunraku.types import Character, Figure, FormatError


@dataclass(frozen=True, eq=False)
class Film:
    """The performer of a depth video, and how it was found; `bunraku.write` puts it into files."""

    path: str  # the folder as given
    capture: Capture  # every stage of the route
    total_seconds: float  # reading included

    @property
    def character(self) -> Character:
        """What was seen of the performer, with skeleton, skin and one clip."""
        return self.capture.character

    @property
    def figure(self) -> Figure:
        """The seen side as a figure of one piece."""
        mesh = self.character.mesh
        return Figure(
            f"{Path(self.path).resolve().name}.ply", mesh, np.zeros(len(mesh.vertices), np.int64)
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the route found doubtful, in plain words."""
        return self.capture.warnings

    @cached_property
    def report(self) -> dict[str, object]:
        """How well the subject was followed, in numbers: what `--report` writes."""
        return report_capture(self.path, self.capture, total_seconds=self.total_seconds)


def capture(folder: Location) -> Film:
    """Turn a depth video into a rigged performer: its seen side, a skeleton and its motion.

    Args:
        folder: NNNN.png depth frames and intrinsics.json of one still camera.

    Raises:
        FormatError: if the folder is no depth video, or shows no moving subject.
    """
    began = time.perf_counter()
    video = read_depth(folder)
    if find_spec("pygel3d") is None:
        message = 'skeletons of depth videos need pygel3d: pip install "bunraku[depth]"'
        raise FormatError(folder, "", message, code=Code.EXTRA_MISSING)
    check_depth(folder, video)
    try:
        captured = capture_performer(video)
    except FormatError:
        raise
    except ValueError as error:
        raise FormatError(folder, "", str(error), code=Code.DEPTH_SUBJECT) from error
    for message in captured.warnings:
        announce(folder, message, code=Code.MATCH_DOUBTFUL)
    return Film(str(folder), captured, time.perf_counter() - began)


def check_film(folder: Location, clips: Sequence[str] | None, landmarks: object) -> None:
    """Refuse clips that a video does not have, and landmarks, which need names of joints.

    Raises:
        FormatError: about the folder or the landmarks.
    """
    for name in clips or ():
        if name != CLIP:
            message = f"has no clip {name!r}; a depth video is one clip, {CLIP!r}"
            raise FormatError(folder, "", message, code=Code.CLIP_MISSING)
    if landmarks is not None:
        message = "name joints, which a depth video does not have before it is captured"
        where = landmarks if isinstance(landmarks, str | Path) else "landmarks"
        raise FormatError(where, "", f"{message}; leave them out", code=Code.LANDMARKS)


def move_by_film(film: Film, found: Figure, *, seed: int, force: bool) -> DepthTransfer:
    """Let a captured performer move a figure, and announce what is doubtful."""
    with collecting_doubts() as doubts:
        transfer = animate_from_depth(film.capture, found.mesh, seed=seed, force=force)
    transfer = replace(transfer, warnings=(*transfer.warnings, *doubts))
    for message in transfer.warnings:
        announce(found.path, message, code=Code.MATCH_DOUBTFUL)
    return transfer

"""What commands do with a depth video: capture its performer, or let it move a figure."""

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bunraku.bones.performer import CLIP
from bunraku.cli.steps import write_report
from bunraku.evaluate.report import report_capture, report_depth_transfer
from bunraku.formats import read_depth, write_character
from bunraku.routes.from_depth import Capture, animate_from_depth, capture_performer
from bunraku.types import Figure, FormatError

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Film:
    """A depth video as a performance, and the options that make no sense for it."""

    folder: Path
    clips: Sequence[str] | None = None
    landmarks: Path | None = None

    def check(self) -> None:
        """Refuse clips that a video does not have, and landmarks, which need names of joints.

        Raises:
            FormatError: about the folder or the landmarks.
        """
        for name in self.clips or ():
            if name != CLIP:
                message = f"has no clip {name!r}; a depth video is one clip, {CLIP!r}"
                raise FormatError(self.folder, "", message)
        if self.landmarks is not None:
            message = "name joints, which a depth video does not have before it is captured"
            raise FormatError(self.landmarks, "", f"{message}; leave --landmarks out")


def film(folder: Path) -> Capture:
    """Read and capture a depth video.

    Raises:
        FormatError: if the folder is no depth video, or shows no moving subject.
    """
    try:
        capture = capture_performer(read_depth(folder))
    except FormatError:
        raise
    except ValueError as error:
        raise FormatError(folder, "", str(error)) from error
    for message in capture.warnings:
        logger.warning("%s: %s", folder, message)
    return capture


def capture(folder: Path, out: Path, report: Path | None) -> None:
    """Write the performer of a depth video: what was seen of it, its skeleton and its motion."""
    started = time.perf_counter()
    found = film(folder)
    mesh = found.character.mesh
    figure = Figure(f"{folder.name}.ply", mesh, np.zeros(len(mesh.vertices), np.int64))
    write_character(out, figure, found.character)
    if report:
        told = report_capture(str(folder), found, total_seconds=time.perf_counter() - started)
        write_report(report, told)


def animate(
    found: Figure, performance: Film, out: Path, report: Path | None, *, seed: int, force: bool
) -> None:
    """Let a depth video move a figure, and write it."""
    started = time.perf_counter()
    performance.check()
    captured = film(performance.folder)
    transfer = animate_from_depth(captured, found.mesh, seed=seed, force=force)
    for message in transfer.warnings:
        logger.warning("%s: %s", found.path, message)
    write_character(out, found, transfer.character)
    if report:
        folder, seconds = str(performance.folder), time.perf_counter() - started
        told = report_depth_transfer(found.path, folder, captured, transfer, total_seconds=seconds)
        write_report(report, told)

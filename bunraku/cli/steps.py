"""What commands have in common: checks before long work, performances, progress."""

import logging
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from bunraku import builtin
from bunraku.cli.failures import about, printing_warnings
from bunraku.errors import NOTE, Code, announce
from bunraku.evaluate.report import report_transfer
from bunraku.formats import read_character, read_motion
from bunraku.formats.files import check_place, read_bytes, write_atomically
from bunraku.formats.sniffing import sniff
from bunraku.humanoids import transfer_motion
from bunraku.retargeting import retarget_clip
from bunraku.routes.from_rig import RigTransfer, animate_from_rig
from bunraku.skinning import linear_blend_skinning
from bunraku.types import Character, Clip, Figure, FormatError, Mesh

logger = logging.getLogger(__name__)


def check_output(
    path: Path | None, suffixes: Sequence[str], *, inputs: Sequence[Path | None]
) -> None:
    """Refuse a file that cannot be written, before any long work.

    Raises:
        FormatError: if its ending is none of `suffixes` (if there are any), its folder is missing
            or closed to us, or it is a folder or one of the inputs.
    """
    if path is None:
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise FormatError(
            path,
            "",
            f"must end in {' or '.join(suffixes)}; choose another name",
            code=Code.OUT_SUFFIX,
        )
    if any(given is not None and path.resolve() == given.resolve() for given in inputs):
        raise FormatError(path, "", "is also read; write to another file", code=Code.OUT_PLACE)
    if path.is_dir():
        raise FormatError(path, "", "is a folder; name a file in it", code=Code.OUT_PLACE)
    check_place(path)


def read_performer(path: Path | None) -> Character:
    """Read what a figure is to be moved by: a rigged character, a motion, or the built-in human.

    Raises:
        FormatError: if the file holds neither.
    """
    if path is None:
        return builtin.human()
    if path.is_dir():
        raise FormatError(
            path,
            "",
            "is a folder; give a rigged .glb, .gltf or .vrm, or a .bvh",
            code=Code.FILE_FOLDER,
        )
    with about(path):
        if sniff(path, read_bytes(path)) != "bvh":
            character = read_character(path)
            if not len(character.mesh.faces):
                message = "has a rig but no surface to compare the figure with; give a whole file"
                raise FormatError(path, "", message, code=Code.RIG_NO_SURFACE)
            return character
        human = builtin.human()
        recorded, clip = read_motion(path)
        return replace(human, clips=(transfer_motion(recorded, clip, human.skeleton),))


def choose_clips(
    performer: Character, names: Sequence[str] | None, path: Path | None
) -> tuple[Clip, ...]:
    """Choose the performer's clips by name; all of them if no name is given.

    Raises:
        FormatError: if there are no clips, or none of that name.
    """
    where = path or Path("built-in human")
    if not performer.clips:
        message = "has a rig but no clips; give an animated file, or use bunraku rig"
        raise FormatError(where, "", message, code=Code.CLIP_MISSING)
    known = {clip.name: clip for clip in performer.clips}
    for name in names or ():
        if name not in known:
            listed = ", ".join(repr(other) for other in known)
            raise FormatError(
                where, "", f"has no clip {name!r}; it has {listed}", code=Code.CLIP_MISSING
            )
    return tuple(known[name] for name in dict.fromkeys(names)) if names else performer.clips


def read_landmarks(
    path: Path | None, performer: Character
) -> Mapping[str, tuple[float, float, float]] | None:
    """Read where a few of the performer's joints are, in the coordinates of the figure's file.

    Raises:
        FormatError: if the file is not {"joint": [x, y, z], ...}, or the joint does not exist.
    """
    if path is None:
        return None
    content = read_bytes(path)
    try:
        landmarks = msgspec.json.decode(content, type=dict[str, tuple[float, float, float]])
    except msgspec.DecodeError as error:
        message = f'must be {{"joint name": [x, y, z], ...}}: {error}'
        raise FormatError(path, "", message, code=Code.LANDMARKS) from error
    known = performer.skeleton.names
    for name in landmarks:
        if name not in known:
            message = f"no such joint; the performance has {', '.join(known)}"
            raise FormatError(path, f"/{name}", message, code=Code.LANDMARKS)
    return landmarks


def place_landmarks(
    landmarks: Mapping[str, tuple[float, float, float]] | None, found: Figure
) -> Mapping[str, tuple[float, float, float]] | None:
    """Turn places in the coordinates of the figure's file, Z up perhaps, into our frame."""
    if landmarks is None:
        return None
    turn, shift = found.world_from_file[:3, :3], found.world_from_file[:3, 3]
    placed = {name: (turn @ np.array(place) + shift).tolist() for name, place in landmarks.items()}
    return {name: (x, y, z) for name, (x, y, z) in placed.items()}


@contextmanager
def working(path: Path) -> Iterator[None]:
    """Show progress on a terminal and warnings about a file while something long runs."""
    package = logging.getLogger("bunraku")
    previous = package.level
    with ExitStack() as stack:
        stack.enter_context(printing_warnings(path, level=NOTE))
        if sys.stderr.isatty():
            columns = TextColumn("{task.description:<24}"), BarColumn(), TimeElapsedColumn()
            progress = Progress(*columns, console=Console(stderr=True), transient=True)
            bar = StageBar(stack.enter_context(progress))
            package.addHandler(bar)
            stack.callback(package.removeHandler, bar)
        package.setLevel(logging.INFO)
        stack.callback(package.setLevel, previous)
        with about(path):
            yield


class StageBar(logging.Handler):
    """Show the stage that a route announces."""

    def __init__(self, progress: Progress) -> None:
        super().__init__(logging.INFO)
        self.progress, self.task = progress, progress.add_task("", total=None)

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record's message, if it is no warning."""
        if record.levelno < logging.WARNING:
            self.progress.update(self.task, description=record.getMessage())


def match(
    source: Character,
    found: Figure,
    clips: Sequence[Clip],
    *,
    seed: int,
    force: bool,
    landmarks: Mapping[str, tuple[float, float, float]] | None = None,
) -> RigTransfer:
    """Run the route, and print what it found doubtful.

    Args:
        source: the performer.
        found: the figure, as it was read.
        clips: of the performer, to carry over.
        seed: of the random choices.
        force: give the result however poor the match.
        landmarks: places of joints in the coordinates of the figure's file.
    """
    transfer = animate_from_rig(
        source,
        found.mesh,
        clips=clips,
        seed=seed,
        force=force,
        landmarks=place_landmarks(landmarks, found),
    )
    for message in transfer.warnings:
        announce(found.path, message, code=Code.MATCH_DOUBTFUL)
    return transfer


def free_feet(transfer: RigTransfer, clips: Sequence[Clip]) -> RigTransfer:
    """Carry the clips over again, with feet that go where the copied turns take them."""
    free = replace(transfer.plan, legs=())
    carried = tuple(retarget_clip(clip, free) for clip in clips)
    return replace(transfer, character=replace(transfer.character, clips=carried))


def at_rest(transfer: RigTransfer) -> Mesh:
    """Move the figure into the rest pose of its performer."""
    mesh, skin = transfer.character.mesh, transfer.character.skin
    vertices = linear_blend_skinning(mesh.vertices, skin.weights, transfer.repose_motion)
    return Mesh(vertices, mesh.faces)


def report_on(
    found: Figure,
    performance: Path | None,
    source: Character,
    transfer: RigTransfer,
    *,
    started: float,
) -> dict[str, object]:
    """Gather the report of a run that began at `started`, in seconds of the same clock."""
    return report_transfer(
        found.path,
        {"path": str(performance or "built-in human")},
        source,
        transfer,
        total_seconds=time.perf_counter() - started,
    )


def write_report(path: Path, report: Mapping[str, object]) -> None:
    """Write a report as JSON that a person can read."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n")

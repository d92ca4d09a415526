"""Train networks, a checkpoint beside the weights: a stop or a crash costs minutes at most."""

import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from threadpoolctl import threadpool_limits

from bunraku.errors import Code
from bunraku.formats.files import Location, read_bytes, write_atomically
from bunraku.types import FormatError
from bunraku.verbs.posing import need_torch

if TYPE_CHECKING:
    from bunraku.neural.corpus import Corpus, Size
    from bunraku.neural.training import Course, Progress


def train_shape(
    out: Location | None = None,
    *,
    minutes: float | None = None,
    resume: bool = False,
    steps: int | None = None,
    until: int | None = None,
    seed: int = 0,
    size: "Size | None" = None,
    show: Callable[["Progress", int], None] = lambda progress, steps: None,
) -> str:
    """Train the shape network on one thread; one seed and one number of steps are one result.

    Args:
        out: weights to write, when the course is at its end; NAME.checkpoint lies beside it all
            the while. In the user's cache folder without.
        minutes: stop after so long, corpus included; more than 0.
        resume: go on from the checkpoint; the result is the same to the bit.
        steps: of the course; as long as that of the built-in network without.
        until: end the course early, at this step, and write the weights as they are then; at once
            if the checkpoint is of that step.
        seed: of everything that is drawn.
        size: how many bodies; as many as for the built-in network without.
        show: told of progress, with the length of the course.

    Returns:
        one line on what was written where.

    Raises:
        FormatError: if a package is missing, `minutes` or `until` is out of range, there is no
            checkpoint of this course to go on from, or there is one that would be lost.
    """
    need_torch("bunraku train")
    from bunraku.neural.corpus import Size, default_folder, load_corpus
    from bunraku.neural.training import Course, read_step

    ends = time.monotonic() + 60 * (minutes if minutes is not None else float("inf"))
    size = size or Size()
    if size.people and find_spec("anny") is None:
        message = 'needs the parametric body anny: pip install "bunraku[train]"'
        raise FormatError("bunraku train", "", message, code=Code.EXTRA_MISSING)
    course = Course(seed=seed) if steps is None else Course(steps=steps, seed=seed)
    goal = _check_range(course.steps, until, minutes)
    path = Path(out) if out is not None else default_folder() / "shape.safetensors"
    place = path.with_suffix(".checkpoint")
    start = _find_start(place, repr(course), goal, resume=resume)
    if start is not None and read_step(start) == goal:
        return _finish(path, start, course.steps)
    path.parent.mkdir(parents=True, exist_ok=True)

    def stop(step: int) -> bool:
        return step >= goal or time.monotonic() > ends

    with threadpool_limits(limits=1):
        corpus = load_corpus(default_folder(), size, seed)
        latest = _train_on(corpus, course, start, place, stop=stop, show=show)
    if (last := read_step(latest)) < goal:
        return f"{place}: step {last} of {course.steps}; go on with --resume"
    return _finish(path, latest, course.steps)


def _train_on(
    corpus: "Corpus",
    course: "Course",
    start: bytes | None,
    place: Path,
    *,
    stop: Callable[[int], bool],
    show: Callable[["Progress", int], None],
) -> bytes:
    """Train until told to stop, every checkpoint in its place; give the last one."""
    from bunraku.neural.training import train

    latest = start or b""

    def keep(stored: bytes) -> None:
        nonlocal latest
        write_atomically(place, stored)
        latest = stored

    try:
        for progress in train(corpus, course, start=start, keep=keep, stop=stop):
            show(progress, course.steps)
    except FormatError:
        raise
    except ValueError as error:
        raise FormatError(place, "", str(error), code=Code.NETWORK) from error
    return latest


def _finish(path: Path, stored: bytes, steps: int) -> str:
    """Write the weights of a checkpoint; say so."""
    from bunraku.neural.training import finished_weights, read_step

    write_atomically(path, finished_weights(stored))
    return f"{path}: trained {read_step(stored)} steps of a course of {steps}"


def _check_range(steps: int, until: int | None, minutes: float | None) -> int:
    """Refuse numbers that no training could keep to; give the last step."""
    goal = steps if until is None else until
    if steps < 1:
        raise FormatError("--steps", "", f"is {steps}; wanted at least 1", code=Code.OPTION)
    if not 1 <= goal <= steps:
        raise FormatError("--until", "", f"is {goal}; wanted 1 to {steps}", code=Code.OPTION)
    if minutes is not None and not minutes > 0:
        raise FormatError("--minutes", "", f"is {minutes}; wanted more than 0", code=Code.OPTION)
    return goal


def _find_start(place: Path, course: str, goal: int, *, resume: bool) -> bytes | None:
    """Read the checkpoint to go on from; starting anew, refuse to lose one of the same course."""
    from bunraku.neural.training import check_origin, read_origin

    if not resume and not place.is_file():
        return None
    stored = read_bytes(place)
    try:
        notes = read_origin(stored)
        check_origin(notes, {"course": course})
    except ValueError as error:
        if not resume:
            return None
        raise FormatError(place, "", str(error), code=Code.NETWORK) from error
    step = int(notes["step"])
    if not resume:
        message = f"is step {step} of this course; go on with --resume, or remove it to start anew"
        raise FormatError(place, "", message, code=Code.OUT_PLACE)
    if step > goal:
        message = f"is at step {step} already, past --until {goal}; ask for a later step"
        raise FormatError(place, "", message, code=Code.OPTION)
    return stored

"""Train networks, a checkpoint beside the weights: a stop or a crash costs minutes at most."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from bunraku import builtin
from bunraku.errors import Code
from bunraku.formats.files import Location, read_bytes, write_atomically
from bunraku.types import FormatError
from bunraku.verbs.posing import need_torch

if TYPE_CHECKING:
    from bunraku.neural.checkpoints import Progress
    from bunraku.neural.corpus import Size
    from bunraku.neural.implicit.corpus import Size as DeformSize
    from bunraku.neural.implicit.training import Course as DeformCourse
    from bunraku.neural.training import Course


def train_shape(
    out: Location | None = None,
    *,
    minutes: float | None = None,
    resume: bool = False,
    steps: int | None = None,
    until: int | None = None,
    weights: Location | None = None,
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
        weights: a file of weights that the course begins with; it is shorter then, and slower.
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
    from bunraku.neural import training
    from bunraku.neural.checkpoints import finished_weights
    from bunraku.neural.corpus import Size, default_folder, load_corpus

    size = size or Size()
    need_people(size.people)
    if weights is not None:
        course = training.tuning_course(_read_weights(weights), steps=steps, seed=seed)
    else:
        course = training.Course(seed=seed)
        course = course if steps is None else replace(course, steps=steps)
    work = Work(
        *("shape", course, partial(load_corpus, default_folder(), size, seed)),
        *(training.train, finished_weights),
    )
    return _train(work, out, minutes=minutes, resume=resume, until=until, show=show)


def train_deform(
    out: Location | None = None,
    *,
    kind: str = "person",
    minutes: float | None = None,
    resume: bool = False,
    until: int | None = None,
    seed: int = 0,
    course: "DeformCourse | None" = None,
    size: "DeformSize | None" = None,
    show: Callable[["Progress", int], None] = lambda progress, steps: None,
) -> str:
    """Train the paper's form: pose space, shape codes, offsets; see `train_shape`.

    Args:
        kind: person or quadruped.
        course: how long each phase is; as long as that of the built-in networks without.
        size: how many shapes; as many as in the paper without.

    Raises:
        ValueError: if course or size are of another kind, or the course of another seed.
    """
    need_torch("bunraku train")
    from bunraku.neural.corpus import KINDS, default_folder
    from bunraku.neural.implicit import training
    from bunraku.neural.implicit.corpus import SIZES, load_implicit_corpus

    if kind not in KINDS:
        message = f"is {kind!r}; wanted one of {', '.join(KINDS)}"
        raise FormatError("--kind", "", message, code=Code.OPTION)
    size = size or SIZES[kind]
    need_people(size.labelled if kind == "person" else 0)
    course = course or training.Course(kind=kind, seed=seed)
    wanted, found = (kind, kind, seed), (course.kind, size.kind, course.seed)
    if wanted != found:
        raise ValueError(f"kinds of course and size, and seed, are {found}; wanted {wanted}")
    work = Work(
        *(
            f"deform-{kind}",
            course,
            partial(load_implicit_corpus, default_folder(), size, seed, builtin.human()),
        ),
        *(training.train, training.finished_form),
    )
    return _train(work, out, minutes=minutes, resume=resume, until=until, show=show)


def _read_weights(path: Location) -> bytes:
    """Read weights of a shape network to begin with."""
    from bunraku.neural.training import load_network

    stored = read_bytes(path)
    try:
        load_network(stored)
    except ValueError as error:
        message = f"holds no shape network ({error})"
        raise FormatError(path, "", message, code=Code.NETWORK) from error
    return stored


def need_people(count: int) -> None:
    """Say how to install anny, if bodies of it are wanted and it is not there."""
    if count and find_spec("anny") is None:
        message = 'needs the parametric body anny: pip install "bunraku[train]"'
        raise FormatError("bunraku train", "", message, code=Code.EXTRA_MISSING)


@dataclass(frozen=True, eq=False)
class Work:
    """What is to be trained, and how."""

    name: str  # of the weights, if no file is named
    course: "Course | DeformCourse"
    load: Callable[[], Any]  # the corpus
    train: Callable[..., "Iterator[Progress]"]
    finish: Callable[[bytes], bytes]  # a checkpoint to weights


def _train(
    work: Work,
    out: Location | None,
    *,
    minutes: float | None,
    resume: bool,
    until: int | None,
    show: Callable[["Progress", int], None],
) -> str:
    """Train until the goal, or for so long, from a checkpoint if there is one to go on from."""
    from bunraku.neural.checkpoints import read_step
    from bunraku.neural.corpus import default_folder

    ends = time.monotonic() + 60 * (minutes if minutes is not None else float("inf"))
    steps = work.course.steps
    goal = _check_range(steps, until, minutes)
    path = Path(out) if out is not None else default_folder() / f"{work.name}.safetensors"
    place = path.with_suffix(".checkpoint")
    start = _find_start(place, repr(work.course), goal, resume=resume)
    if start is not None and read_step(start) == goal:
        return _finish(work, path, start)
    path.parent.mkdir(parents=True, exist_ok=True)

    def stop(step: int) -> bool:
        return step >= goal or time.monotonic() > ends

    with threadpool_limits(limits=1):
        latest = _train_on(work, start, place, stop=stop, show=show)
    if (last := read_step(latest)) < goal:
        return f"{place}: step {last} of {steps}; go on with --resume"
    return _finish(work, path, latest)


def _train_on(
    work: Work,
    start: bytes | None,
    place: Path,
    *,
    stop: Callable[[int], bool],
    show: Callable[["Progress", int], None],
) -> bytes:
    """Train until told to stop, every checkpoint in its place; give the last one."""
    latest = start or b""

    def keep(stored: bytes) -> None:
        nonlocal latest
        write_atomically(place, stored)
        latest = stored

    corpus = work.load()
    try:
        for progress in work.train(corpus, work.course, start=start, keep=keep, stop=stop):
            show(progress, work.course.steps)
    except FormatError:
        raise
    except ValueError as error:
        raise FormatError(place, "", str(error), code=Code.NETWORK) from error
    return latest


def _finish(work: Work, path: Path, stored: bytes) -> str:
    """Write the weights of a checkpoint; say so."""
    from bunraku.neural.checkpoints import read_step

    write_atomically(path, work.finish(stored))
    return f"{path}: trained {read_step(stored)} steps of a course of {work.course.steps}"


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
    """Read the checkpoint to go on from; starting anew, refuse to lose the one that is there."""
    from bunraku.neural.checkpoints import check_origin, read_origin

    if not resume and not place.is_file():
        return None
    stored = read_bytes(place)
    try:
        notes = read_origin(stored)
        check_origin(notes, {"course": course})
    except ValueError as error:
        if not resume:
            message = "is not of this course; name another file with -o, or remove it to start anew"
            raise FormatError(place, "", message, code=Code.OUT_PLACE) from error
        raise FormatError(place, "", str(error), code=Code.NETWORK) from error
    step = int(notes["step"])
    if not resume:
        message = f"is step {step} of this course; go on with --resume, or remove it to start anew"
        raise FormatError(place, "", message, code=Code.OUT_PLACE)
    if step > goal:
        message = f"is at step {step} already, past --until {goal}; ask for a later step"
        raise FormatError(place, "", message, code=Code.OPTION)
    return stored

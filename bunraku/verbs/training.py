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
    from bunraku.neural.corpus import Size
    from bunraku.neural.training import Progress


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
        minutes: stop after so long, corpus included.
        resume: go on from the checkpoint; the result is the same to the bit.
        steps: of the course; as long as that of the built-in network without.
        until: end the course early, at this step, and write the weights as they are then.
        seed: of everything that is drawn.
        size: how many bodies; as many as for the built-in network without.
        show: told of progress, with the length of the course.

    Returns:
        one line on what was written where.

    Raises:
        FormatError: if a package is missing, or there is no checkpoint of this course.
    """
    need_torch("bunraku train")
    from bunraku.neural.corpus import Size, default_folder, load_corpus
    from bunraku.neural.training import Course, finished_weights, read_step, train

    ends = time.monotonic() + 60 * (minutes if minutes is not None else float("inf"))
    size = size or Size()
    if size.people and find_spec("anny") is None:
        message = 'needs the parametric body anny: pip install "bunraku[train]"'
        raise FormatError("bunraku train", "", message, code=Code.EXTRA_MISSING)
    course = Course(seed=seed) if steps is None else Course(steps=steps, seed=seed)
    path = Path(out) if out is not None else default_folder() / "shape.safetensors"
    place = path.with_suffix(".checkpoint")
    start = read_bytes(place) if resume else None
    path.parent.mkdir(parents=True, exist_ok=True)
    latest, progress = start or b"", None

    def keep(stored: bytes) -> None:
        nonlocal latest
        write_atomically(place, stored)
        latest = stored

    def stop(step: int) -> bool:
        return step == until or time.monotonic() > ends

    with threadpool_limits(limits=1):
        corpus = load_corpus(default_folder(), size, seed)
        steps_taken = train(corpus, course, start=start, keep=keep, stop=stop)
        try:
            for progress in steps_taken:
                show(progress, course.steps)
        except ValueError as error:
            raise FormatError(place, "", str(error), code=Code.NETWORK) from error
    last = progress.step if progress is not None else read_step(latest)
    if last not in (course.steps, until):
        return f"{place}: step {last} of {course.steps}; go on with --resume"
    write_atomically(path, finished_weights(latest))
    return f"{path}: trained {last} steps of a course of {course.steps}"

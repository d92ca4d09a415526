"""What commands have in common: checks before long work, and progress while it runs."""

import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from bunraku.cli.failures import about, printing_warnings
from bunraku.errors import NOTE, Code
from bunraku.formats.files import check_place
from bunraku.formats.usd import USD_SUFFIXES, import_usd
from bunraku.types import FormatError
from bunraku.verbs.engines import ENGINES

if TYPE_CHECKING:
    from bunraku.neural.checkpoints import Progress as TrainingProgress


def check_output(
    path: Path | None, suffixes: Sequence[str], *, inputs: Sequence[Path | None]
) -> None:
    """Refuse a file that cannot be written, before any long work.

    Raises:
        FormatError: if its ending is none of `suffixes` (if there are any), its folder is missing
            or closed to us, it is a folder or one of the inputs, or its format needs an extra.
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
    read = [given.resolve() for given in inputs if given is not None]
    inside = path.exists() and any(given in path.resolve().parents for given in read)
    if inside or path.resolve() in read:
        raise FormatError(path, "", "is also read; write to another file", code=Code.OUT_PLACE)
    if path.is_dir():
        raise FormatError(path, "", "is a folder; name a file in it", code=Code.OUT_PLACE)
    check_place(path)
    if path.suffix.lower() in USD_SUFFIXES:
        import_usd(path)


def list_suffixes(*, vrm: bool) -> list[str]:
    """List how the name of a moving figure's file may end."""
    return [".glb", ".vrm", *(() if vrm else USD_SUFFIXES)]


def check_engine(engine: str | None) -> None:
    """Refuse an unknown engine, before any long work.

    Raises:
        FormatError: if there is no preset of that name.
    """
    if engine not in (None, *ENGINES):
        message = f"no such preset; wanted {', '.join(ENGINES)}"
        raise FormatError(f"--for {engine}", "", message, code=Code.OPTION)


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


def files_within(performance: Path | None) -> list[Path]:
    """List what is read of a folder that performs, so that no output replaces it."""
    if performance is None or not performance.is_dir():
        return []
    return [path for path in performance.iterdir() if path.is_file()]


@contextmanager
def training_bar() -> Iterator[Callable[["TrainingProgress", int], None]]:
    """Show how far training is, and how good, on a terminal."""
    columns = TextColumn("{task.description:<40}"), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("bodies", total=None)

        def show(now: "TrainingProgress", steps: int) -> None:
            text = f"{100 * now.error:.1f} % off"
            if now.agreement == now.agreement:  # nan where parts are not asked
                text = f"parts {now.agreement:.1%}  {text}"
            bar.update(task, description=text, completed=now.step, total=steps)

        yield show


class StageBar(logging.Handler):
    """Show the stage that a route announces."""

    def __init__(self, progress: Progress) -> None:
        super().__init__(logging.INFO)
        self.progress, self.task = progress, progress.add_task("", total=None)

    def emit(self, record: logging.LogRecord) -> None:
        """Show a record's message, if it is no warning."""
        if record.levelno < logging.WARNING:
            self.progress.update(self.task, description=record.getMessage())

"""Turn what went wrong into one line and an exit code."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from bunraku.errors import Code
from bunraku.verbs.failing import about, shorten

__all__ = ["about", "describe_failure", "printing_warnings", "shorten"]
SUCCESS, BAD_INPUT, NO_MATCH, INTERRUPTED = 0, 2, 3, 130
UsageError: type[BaseException] = typer.BadParameter.__mro__[1]  # of the parser typer came with


def describe_failure(error: BaseException) -> tuple[int, str]:
    """Give the exit code and the one line for an error that a user can act on.

    Raises:
        BaseException: the error itself, if it is ours: a bug keeps its traceback.
    """
    from bunraku.types import FormatError, MatchError

    match error:
        case MatchError():
            return NO_MATCH, shorten(f"error: {error} [{Code.MATCH_POOR.name}]")
        case FormatError():
            return BAD_INPUT, shorten(f"error: {error} [{error.code.name}]")
        case KeyboardInterrupt() | typer.Abort():
            return INTERRUPTED, "error: interrupted; nothing is left half-written"
        case BrokenPipeError():
            return SUCCESS, ""
        case UsageError():
            return BAD_INPUT, shorten(f"error: {_usage_message(error)}")
    raise error


def _usage_message(error: BaseException) -> str:
    """Say which option is wrong, and where help is."""
    message = getattr(error, "format_message", error.__str__)().rstrip(".")
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "bunraku"
    return f"{command}: {message}. See {command} --help"


class WarningLines(logging.Handler):
    """Print each warning once, as `warning: FILE: ...`."""

    def __init__(self, path: Path, level: int) -> None:
        super().__init__(level)
        self.path, self.printed = path, set[str]()

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record, unless it has been."""
        message = record.getMessage()
        if getattr(record, "about", None) is None and not message.startswith(str(self.path)):
            message = f"{self.path}: {message}"
        if message not in self.printed:
            self.printed.add(message)
            code = getattr(record, "code", None)
            mark = f" [{code.name}]" if isinstance(code, Code) else ""
            typer.echo(shorten(f"warning: {message}{mark}"), err=True)


@contextmanager
def printing_warnings(path: Path, *, level: int = logging.WARNING) -> Iterator[None]:
    """Print the package's warnings as lines about a file, and nobody else's.

    Args:
        path: the file that is named where a warning names none.
        level: of the least that is printed: WARNING, or NOTE for what is odd but harmless.
    """
    logger, handler = logging.getLogger("bunraku"), WarningLines(path, level)
    logger.addHandler(handler)
    logging.captureWarnings(True)  # NumPy's own go to a logger that nobody prints
    logging.getLogger("py.warnings").addHandler(logging.NullHandler())
    try:
        yield
    finally:
        logging.captureWarnings(False)
        logger.removeHandler(handler)

"""Errors that name a file, on one line, whoever raised them."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bunraku.errors import Code

LONGEST_LINE = 300


@contextmanager
def about(path: Path | str) -> Iterator[None]:
    """Name a file in every error that does not name one itself."""
    from bunraku.types import FormatError, MatchError  # help must show before NumPy is there

    try:
        yield
    except FormatError:
        raise
    except MatchError as error:
        if str(error).startswith(f"{path}: "):
            raise
        raise MatchError(f"{path}: {error}") from error
    except BrokenPipeError:
        raise
    except OSError as error:
        reason = f"{error.strerror or error}; check the path"
        raise FormatError(error.filename or path, "", reason, code=Code.FILE_UNREADABLE) from error
    except MemoryError as error:
        raise FormatError(
            path, "", "needs more memory than there is; simplify it", code=Code.LIMIT_MEMORY
        ) from error
    except ValueError as error:
        raise FormatError(path, "", str(error)) from error


def shorten(line: str, length: int = LONGEST_LINE) -> str:
    """Put a message on one line of at most `length` characters, cut in the middle."""
    line = " ".join(line.split())
    if len(line) <= length:
        return line
    tail = length // 3
    return f"{line[: length - tail - 5]} ... {line[-tail:]}"

"""Bytes in and out: reading with a cap, files named by other files, writing that is never torn."""

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote

from bunraku import limits
from bunraku.errors import Code
from bunraku.types import FormatError

Location = str | os.PathLike[str]


def read_bytes(path: Location, *, limit: int = limits.BYTES) -> bytes:
    """Read a whole file of at most `limit` bytes.

    Raises:
        FormatError: if there is no such file, or it is no regular file, unreadable, empty or
            larger than the limit.
    """
    try:
        with open(path, "rb") as stream:
            status = os.fstat(stream.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise FormatError(
                    path, "", "is a device or pipe; give a regular file", code=Code.FILE_DEVICE
                )
            if status.st_size > limit:
                raise FormatError(
                    path,
                    "",
                    f"has {status.st_size} bytes, more than the {limit} allowed",
                    code=Code.LIMIT_BYTES,
                )
            content = stream.read(status.st_size + 1)  # the limit itself would be asked for
    except (OSError, ValueError) as error:
        if isinstance(error, FormatError):
            raise
        raise _reading_trouble(path, error) from None
    if not content:
        raise FormatError(
            path, "", "is empty (0 bytes); export or download it again", code=Code.FILE_EMPTY
        )
    if len(content) > status.st_size:
        raise FormatError(
            path,
            "",
            "grew while it was read; try again when it is whole",
            code=Code.FILE_UNREADABLE,
        )
    return content


def read_beside(path: Location, uri: str, *, where: str = "", limit: int = limits.BYTES) -> bytes:
    """Read a file that `path` names by a relative URI; it may not leave the folder of `path`.

    Args:
        path: the file that holds the URI.
        uri: as written there; percent escapes are decoded first.
        where: place of the URI in `path`, for the message.
        limit: largest size in bytes.

    Raises:
        FormatError: about `path`, if the URI has a scheme, is absolute, leaves the folder (also
            through a link) or names no readable regular file.
    """
    folder = Path(path).resolve().parent
    name = unquote(uri)
    shown = uri if len(uri) <= 60 else uri[:57] + "..."
    forbidden = "\\" in name or ":" in name or not name.isprintable() or name.startswith("/")
    try:
        if forbidden or not (beside := (folder / name).resolve()).is_relative_to(folder):
            raise FormatError(
                path,
                where,
                f"refers to {shown!r}; only a relative path inside its folder is read",
                code=Code.URI_FORBIDDEN,
            )
        if not beside.is_file():
            raise FormatError(
                path,
                where,
                f"refers to {shown!r}, which is missing; put it beside",
                code=Code.URI_MISSING,
            )
        return read_bytes(beside, limit=limit)
    except (OSError, ValueError, RuntimeError) as error:
        if isinstance(error, FormatError) and error.path == str(path):
            raise
        reason = error.message if isinstance(error, FormatError) else "cannot be a file name"
        raise FormatError(
            path, where, f"refers to {shown!r}, which {reason}", code=Code.URI_MISSING
        ) from None


def write_atomically(path: Location, content: bytes) -> None:
    """Replace a file in one step: whoever looks sees the old bytes or all of the new ones.

    Raises:
        FormatError: if it cannot be written; nothing is left behind then.
    """
    target = _find_target(path)
    try:
        folder = os.open(target.parent, os.O_RDONLY)
        try:
            _write_beside(target, content, folder)
            with suppress(OSError):  # some file systems cannot sync a folder
                os.fsync(folder)
        finally:
            os.close(folder)
    except OSError as error:
        raise FormatError(path, "", _writing_trouble(error), code=Code.OUT_FAILED) from None


def check_place(path: Location) -> None:
    """Refuse a file that could not be written, before the long work that leads to it.

    Raises:
        FormatError: if its folder is missing or closed to us, or something else is in its place.
    """
    target = _find_target(path)
    try:
        handle = _open_nameless(target.parent)
        if handle is not None:
            os.close(handle)
            return
        partial = _name_partial(target)
        with _removed_on_failure(partial):
            partial.touch(exist_ok=False)
        partial.unlink()
    except OSError as error:
        raise FormatError(path, "", _writing_trouble(error), code=Code.OUT_PLACE) from None


def _find_target(path: Location) -> Path:
    """Follow links to where a file really goes."""
    try:
        target = Path(os.path.realpath(path))
        _refuse_target(path, target)
    except FormatError:
        raise
    except (OSError, ValueError) as error:
        raise FormatError(path, "", _writing_trouble(error), code=Code.OUT_PLACE) from None
    return target


def _open_nameless(folder: Path) -> int | None:
    """Open a file that has no name yet, and is gone when the program is killed; Linux has such.

    Raises:
        OSError: if there can be no new files in the folder.
    """
    if not hasattr(os, "O_TMPFILE") or not os.path.exists("/proc/self/fd"):
        return None
    try:
        return os.open(folder, os.O_WRONLY | os.O_TMPFILE, 0o666)
    except OSError as error:
        if error.errno in (errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL):
            return None  # not on this file system
        raise


def _write_beside(target: Path, content: bytes, folder: int) -> None:
    """Write a file without a name, then give it one.

    Where nothing has the target's name, it gets that at once; else it has another for a moment,
    to replace the old file with.
    """
    handle = _open_nameless(target.parent)
    if handle is None:
        return _write_and_rename(target, content)
    with os.fdopen(handle, "wb") as stream:
        _write_through(stream, content)
        source = f"/proc/self/fd/{handle}"
        with suppress(FileExistsError):
            os.link(source, target.name, dst_dir_fd=folder)
            return None
        partial = _name_partial(target)
        with _removed_on_failure(partial):
            os.link(source, partial.name, dst_dir_fd=folder)
            os.replace(partial, target)
    return None


def _write_and_rename(target: Path, content: bytes) -> None:
    """Write a file under another name, then rename it."""
    partial = _name_partial(target)
    with _removed_on_failure(partial):
        with open(partial, "xb") as stream:
            _write_through(stream, content)
        os.replace(partial, target)


def _name_partial(target: Path) -> Path:
    """Name a file that is not finished."""
    return target.with_name(f".{target.name[:40]}.{secrets.token_hex(6)}")


def _write_through(stream: BinaryIO, content: bytes) -> None:
    """Write to the disk itself."""
    stream.write(content)
    stream.flush()
    os.fsync(stream.fileno())


@contextmanager
def _removed_on_failure(partial: Path) -> Iterator[None]:
    """Remove a file if anything goes wrong."""
    try:
        yield
    except BaseException:
        with suppress(OSError):
            partial.unlink()
        raise


def _refuse_target(path: Location, target: Path) -> None:
    """Raise a FormatError if something that must stay is where the file would go."""
    if target.is_dir():
        raise FormatError(path, "", "is a folder; name a file to write", code=Code.OUT_PLACE)
    if target.exists() and not target.is_file():
        raise FormatError(
            path, "", "is a device or pipe; name a file to write", code=Code.OUT_PLACE
        )
    if target.exists() and not os.access(target, os.W_OK):
        raise FormatError(path, "", "is write-protected; choose another name", code=Code.OUT_PLACE)


def _reading_trouble(path: Location, error: Exception) -> FormatError:
    """Say why a file cannot be read, and what to do."""
    match error:
        case FileNotFoundError():
            message, code = "does not exist; check the name and the folder", Code.FILE_MISSING
        case IsADirectoryError():
            message, code = "is a folder; give a file", Code.FILE_FOLDER
        case PermissionError():
            message, code = "may not be read; check its permissions", Code.FILE_DENIED
        case OSError():
            reason = f"cannot be read ({error.strerror}); check the name"
            message, code = reason, Code.FILE_UNREADABLE
        case _:
            message, code = "cannot be a file name", Code.FILE_UNREADABLE
    return FormatError(path, "", message, code=code)


def _writing_trouble(error: Exception) -> str:
    """Say why a file cannot be written, and what to do."""
    match error:
        case FileNotFoundError():
            return "cannot be written: its folder does not exist; create it first"
        case NotADirectoryError():
            return "cannot be written: its folder is a file"
        case PermissionError():
            return "cannot be written: permission denied; choose another folder"
        case OSError():
            return f"cannot be written ({error.strerror}); choose another place"
    return "cannot be a file name"

"""Depth videos come as folders, which a page cannot upload: they are packed into a zip file."""

import io
import shutil
import zipfile
from pathlib import Path, PurePosixPath

from bunraku.errors import Code
from bunraku.types import FormatError

MAGIC = b"PK\x03\x04"
MASKS = "mask"
KEPT = (".png", ".json")
MOST_FILES = 20_000


def unpack_film(name: str, content: bytes, folder: Path, *, most: int) -> None:
    """Unpack pictures, masks and lens of a depth video; folders within, and all else, are not kept.

    Args:
        name: of the zip file, for messages.
        content: its bytes.
        folder: for the files; it is made.
        most: bytes that they may have in all.

    Raises:
        FormatError: if it is no zip file, or holds too much.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = [entry for entry in archive.infolist() if _is_kept(entry)]
            if len(entries) > MOST_FILES or sum(entry.file_size for entry in entries) > most:
                message = f"unpacks to more than {most >> 20} MB; cut the video"
                raise FormatError(name, "", message, code=Code.LIMIT_BYTES)
            shutil.rmtree(folder, ignore_errors=True)  # an earlier one of that name
            (folder / MASKS).mkdir(parents=True)
            for entry in entries:
                path = PurePosixPath(entry.filename)
                place = folder / MASKS if path.parent.name == MASKS else folder
                (place / path.name).write_bytes(archive.read(entry))
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError, EOFError) as error:
        message = f"is a damaged or locked zip file ({error}); pack it again"
        raise FormatError(name, "", message, code=Code.FILE_KIND) from error


def _is_kept(entry: zipfile.ZipInfo) -> bool:
    """Tell whether a file can belong to a depth video; macOS adds files that begin with a dot."""
    path = PurePosixPath(entry.filename)
    plain = not entry.is_dir() and not path.name.startswith(".") and path.name.isprintable()
    return plain and path.suffix.lower() in KEPT

"""Depth videos come as folders, which a page cannot upload: they are packed into a zip file."""

import io
import re
import shutil
import struct
import tempfile
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from bunraku.errors import Code
from bunraku.formats.depth_video import LENS_FILES
from bunraku.types import FormatError

MAGIC = b"PK\x03\x04"
MASKS = "mask"
KEPT = (".png", ".json")
MOST_FILES = 20_000
CHUNK = 1 << 20  # bytes that are unpacked at a time
_DAMAGES = (zipfile.BadZipFile, zlib.error, struct.error)
_ODDITIES = (RuntimeError, NotImplementedError, EOFError, ValueError)  # locked, cut, misnamed

Entries = dict[PurePosixPath, zipfile.ZipInfo]


def unpack_film(name: str, content: bytes, folder: Path, *, most: int) -> None:
    """Unpack pictures, masks and lens of the one depth video in a zip file, and nothing else.

    Args:
        name: of the zip file, for messages.
        content: its bytes.
        folder: for the files, in a folder that is there; it appears only when all are whole.
        most: bytes that they may have in all.

    Raises:
        FormatError: if it is no sound zip file, holds too much, or not one depth video.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            chosen = _choose(name, [entry for entry in archive.infolist() if _is_kept(entry)])
            _check(name, list(chosen.values()), most)
            with tempfile.TemporaryDirectory(prefix=".", dir=folder.parent) as beside:
                film = Path(beside) / "film"
                (film / MASKS).mkdir(parents=True)
                for place, entry in chosen.items():
                    _write(archive, entry, film / place)
                shutil.rmtree(folder, ignore_errors=True)  # an earlier one of that name
                film.rename(folder)
    except FormatError:
        raise
    except (*_DAMAGES, *_ODDITIES) as error:
        message = f"is a damaged or locked zip file ({error}); pack it again"
        raise FormatError(name, "", message, code=Code.FILE_KIND) from error


def _is_kept(entry: zipfile.ZipInfo) -> bool:
    """Tell whether a file can belong to a depth video; macOS adds files that begin with a dot."""
    path = PurePosixPath(entry.filename)
    plain = not entry.is_dir() and not path.name.startswith(".") and path.name.isprintable()
    return plain and path.suffix.lower() in KEPT


def _choose(name: str, entries: list[zipfile.ZipInfo]) -> Entries:
    """Choose the files of the one folder of frames: by their places in the film's folder."""
    paths = [PurePosixPath(entry.filename) for entry in entries]
    home = _find_home(name, paths)
    lenses = {path.parent for path in paths if path.name in LENS_FILES}
    above = home.parent if home not in lenses else home  # where the lens may lie as well
    chosen: Entries = {}
    for path, entry in zip(paths, entries, strict=True):
        if path.parent == home or (path.parent == above and path.name in LENS_FILES):
            place = PurePosixPath(path.name)
        elif path.parent.parent == home and _is_mask(path):
            place = PurePosixPath(MASKS, path.name)
        else:
            continue
        place = place.with_suffix(place.suffix.lower())
        if place in chosen:
            message = f"holds {path.name[:50]} more than once; pack one file of each name"
            raise FormatError(name, "", message, code=Code.DEPTH_FRAMES)
        chosen[place] = entry
    return chosen


def _find_home(name: str, paths: list[PurePosixPath]) -> PurePosixPath:
    """Find the folder with frames; of several the one with a lens."""
    frames = [path for path in paths if path.suffix.lower() == ".png" and not _is_mask(path)]
    homes = {path.parent for path in frames if re.search(r"\d", path.stem)}
    if not homes:
        message = "holds no NNNN.png depth frames; pack the folder of a depth video"
        raise FormatError(name, "", message, code=Code.DEPTH_FRAMES)
    if len(homes) > 1:
        with_lens = homes & {path.parent for path in paths if path.name in LENS_FILES}
        if len(with_lens) != 1:
            shown = ", ".join(sorted(home.name or "." for home in homes))[:80]
            message = f"holds {len(homes)} folders of pictures ({shown}), wanted one with the lens"
            raise FormatError(
                name, "", f"{message} in it; pack that folder", code=Code.DEPTH_FRAMES
            )
        homes = with_lens
    return homes.pop()


def _is_mask(path: PurePosixPath) -> bool:
    return path.parent.name.lower() == MASKS


def _check(name: str, entries: list[zipfile.ZipInfo], most: int) -> None:
    """Refuse what is too much by its own account, or packed so that it can lie about it."""
    if len(entries) > MOST_FILES or sum(entry.file_size for entry in entries) > most:
        message = f"unpacks to more than {most >> 20} MB; cut the video"
        raise FormatError(name, "", message, code=Code.LIMIT_BYTES)
    if any(e.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for e in entries):
        message = "is packed by a rare method; pack it again as a plain zip file"
        raise FormatError(name, "", message, code=Code.FILE_KIND)


def _write(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, place: Path) -> None:
    """Unpack a file piece by piece; never more than the directory says, whatever follows."""
    left = entry.file_size
    with archive.open(entry) as packed, place.open("xb") as file:
        while piece := packed.read(CHUNK):
            left -= len(piece)
            if left < 0:
                raise zipfile.BadZipFile(f"{place.name} is longer than its directory says")
            file.write(piece)
    if left:
        raise zipfile.BadZipFile(f"{place.name} is shorter than its directory says")

"""Jobs: a line of a CSV each, and a key made of all that decides the result."""

import csv
import hashlib
import io
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from bunraku import __version__
from bunraku.errors import Code
from bunraku.formats.depth_video import frame_files, lens_file
from bunraku.formats.files import Location, read_beside, read_bytes
from bunraku.types import FormatError

MOST_JOBS = 1_000_000
YES, NO = ("1", "yes", "true"), ("", "0", "no", "false")
KEY_LENGTH = 16  # hexadecimal digits: 64 bits, a million jobs clash once in 37 million batches


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """One figure to animate; every field is a column of JOBS.csv and an option of `animate`."""

    figure: str
    performance: str | None = None
    clips: tuple[str, ...] = ()
    landmarks: str | None = None
    contacts: bool = True
    seed: int = 0
    up: str | None = None
    facing: str | None = None
    force: bool = False
    bvh: bool = False
    usd: bool = False
    vrm: bool = False
    engine: str | None = msgspec.field(default=None, name="for")


COLUMNS = Job.__struct_encode_fields__


def read_jobs(path: Location) -> list[Job]:
    """Read a CSV with a header; relative paths in it start from its folder.

    Columns are figure, performance, clips (names between semicolons), and any option of
    `animate`; all but the first may be missing or empty.

    Raises:
        FormatError: with the line, if a column is unknown or a value is none of its kind.
    """
    try:
        text = read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(
            path, "", f"is no UTF-8 text ({error.reason}); save it as CSV", code=Code.JOBS
        ) from None
    lines = csv.DictReader(io.StringIO(text, newline=""), skipinitialspace=True)
    _check_columns(path, [name.strip() for name in lines.fieldnames or ()])
    folder = Path(os.path.abspath(path)).parent
    jobs = list(_read_rows(path, lines, folder))
    if not jobs:
        raise FormatError(
            path, "line 2", "there are no jobs; write a figure a line", code=Code.JOBS
        )
    return jobs


def _check_columns(path: Location, names: Sequence[str]) -> None:
    for name in names:
        if name not in COLUMNS:
            message = f"unknown column {name[:40]!r}; there are {', '.join(COLUMNS)}"
            raise FormatError(path, "line 1", message, code=Code.JOBS)
    if "figure" not in names:
        raise FormatError(
            path, "line 1", "has no column 'figure'; name the columns in line 1", code=Code.JOBS
        )


def _read_rows(path: Location, lines: "csv.DictReader[str]", folder: Path) -> Iterator[Job]:
    """Turn the lines below the header into jobs; empty ones are left out."""
    for row in lines:
        where = f"line {lines.line_num}"
        if None in row:
            raise FormatError(
                path, where, "has more cells than line 1; quote cells with commas", code=Code.JOBS
            )
        cells = {(name or "").strip(): (cell or "").strip() for name, cell in row.items()}
        if not any(cells.values()):
            continue
        try:
            yield read_job(cells, folder)
        except ValueError as error:
            raise FormatError(path, where, str(error), code=Code.JOBS) from None


def read_job(cells: Mapping[str, str], folder: Path) -> Job:
    """Make a job of the cells of a line.

    Raises:
        ValueError: if a cell is empty that must not be, or none of its kind.
    """
    given: dict[str, object] = {name: cell for name, cell in cells.items() if cell}
    if "figure" not in given:
        raise ValueError("names no figure; fill the column or delete the line")
    for name in ("figure", "performance", "landmarks"):
        if name in given:
            given[name] = str(folder / cells[name])
    if "clips" in given:
        given["clips"] = [name.strip() for name in cells["clips"].split(";") if name.strip()]
    for name in ("contacts", "force", "bvh", "usd", "vrm"):
        if name in given:
            given[name] = _as_truth(name, cells[name])
    try:
        return msgspec.convert(given, Job, strict=False)
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at ")
        raise ValueError(f"{place.strip('`$.')}: {message.replace('`', '')}") from None


def _as_truth(name: str, cell: str) -> bool:
    if cell.lower() not in (*YES, *NO):
        raise ValueError(f"{name}: {cell[:40]!r} is neither yes nor no")
    return cell.lower() in YES


def name_result(job: Job) -> str:
    """Name a job's results after its figure and a hash of all that decides them.

    That is the bytes of every file that it reads, the options, and the version of the package:
    the same name means the same result.
    """
    digest = hashlib.sha256(__version__.encode())
    options = msgspec.structs.replace(job, figure="", performance=None, landmarks=None)
    digest.update(msgspec.json.encode(options))
    for path in (job.figure, job.performance, job.landmarks):
        digest.update(_hash_file(path).encode())
    stem = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(job.figure).stem)[:60] or "figure"
    return f"{stem}-{digest.hexdigest()[:KEY_LENGTH]}"


def _hash_folder(folder: Path) -> str:
    """Hash the frames, masks and lens of a depth video; nothing else in there decides."""
    digest = hashlib.sha256()
    files = [*frame_files(folder).values(), *frame_files(folder / "mask").values()]
    for file in (*files, lens_file(folder)):
        if file is not None:
            digest.update(f"{file.relative_to(folder)}\n{_hash_file(str(file))}\n".encode())
    return digest.hexdigest()


def _hash_file(path: str | None) -> str:
    """Hash a file and those beside it that it names; what cannot be read, by its name."""
    if path is None:
        return "none"
    if Path(path).is_dir():
        return _hash_folder(Path(path))
    try:
        content = read_bytes(path)
    except FormatError as error:
        return f"unreadable {error}"
    digest = hashlib.sha256(Path(path).suffix.encode() + content)
    for uri in _named_files(path, content):
        try:
            digest.update(read_beside(path, uri))
        except FormatError as error:
            digest.update(str(error).encode())
    return digest.hexdigest()


def _named_files(path: str, content: bytes) -> list[str]:
    """List the files that a .gltf or .obj names; what they hold decides the result as well."""
    match Path(path).suffix.lower():
        case ".gltf":
            found = re.findall(rb'"uri"\s*:\s*"([^"\\]+)"', content)
        case ".obj":
            found = re.findall(rb"^mtllib[ \t]+(.+?)[ \t\r]*$", content, re.MULTILINE)
        case _:
            found = []
    names = [name.decode("utf-8", "replace") for name in found]
    return [name for name in names if not name.startswith("data:")]

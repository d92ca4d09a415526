"""Write what a verb gave, by the suffix of the file."""

from collections.abc import Mapping
from pathlib import Path

import msgspec

from bunraku.formats import write_character, write_mesh
from bunraku.formats.files import Location, write_atomically
from bunraku.types import FormatError, Mesh
from bunraku.verbs.results import Result


def write(path: Location, thing: Result | Mesh) -> None:
    """Write a result or a surface, in one step: whoever looks sees the old file or all of the new.

    Args:
        path: by its suffix, a result becomes the figure's own document with skeleton, skin and
            clips (.glb) or its report (.json); a mesh becomes .obj, .ply or .glb.
        thing: what `animate`, `rig` or `repose` gave.

    Raises:
        FormatError: if the suffix is another one, or the file cannot be written.
    """
    if isinstance(thing, Mesh):
        return write_mesh(path, thing)
    match Path(path).suffix.lower():
        case ".glb":
            write_character(path, thing.figure, thing.character)
        case ".json":
            write_report(path, thing.report)
        case other:
            wanted = "wanted .glb, or .json for the report"
            raise FormatError(path, "", f"cannot hold a result as {other or 'no suffix'}; {wanted}")


def write_report(path: Location, report: Mapping[str, object]) -> None:
    """Write a report as JSON that a person can read."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n")

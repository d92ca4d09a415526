"""Write what a verb gave, by the suffix of the file."""

import re
from collections.abc import Mapping
from pathlib import Path

import msgspec

from bunraku.errors import Code
from bunraku.formats import write_character, write_mesh, write_motion, write_usd
from bunraku.formats.files import Location, write_atomically
from bunraku.types import Character, FormatError, Mesh
from bunraku.verbs.engines import name_bones, prepare_for
from bunraku.verbs.failing import about
from bunraku.verbs.filming import Film
from bunraku.verbs.posing import Posed
from bunraku.verbs.results import Result


def write(
    path: Location,
    thing: Result | Film | Posed | Mesh,
    *,
    vrm: bool = False,
    engine: str | None = None,
) -> None:
    """Write a result or a surface, in one step: whoever looks sees the old file or all of the new.

    Args:
        path: its suffix decides. A result becomes the figure's own document with skeleton, skin
            and clips (.glb, .vrm), the same as USD (.usdz, .usdc, .usda), its motion alone (.bvh;
            several clips become NAME-CLIP.bvh), or its report (.json); .obj takes the surface of a
            posed figure alone (several poses become NAME-001.obj). A mesh becomes .obj, .ply or
            .glb.
        thing: what `animate`, `rig`, `repose` or `pose` gave.
        vrm: say which joints are which bones of a human, by VRM 1.0; .vrm says it too.
        engine: name joints and clips as blender, godot, unity or unreal know them.

    Raises:
        FormatError: if the suffix is another one, the file cannot be written, the engine is
            unknown, a VRM is asked for and the performance has not all the bones of a human or
            the file is USD, or USD's extra is missing.
    """
    if isinstance(thing, Mesh):
        write_mesh(path, thing)
        return
    with about(str(path)):
        _write_result(path, thing, vrm=vrm, engine=engine)


def _write_result(
    path: Location, result: Result | Film | Posed, *, vrm: bool, engine: str | None
) -> None:
    character = prepare_for(result.character, engine)
    match Path(path).suffix.lower():
        case ".glb" | ".vrm":
            bones = name_bones(character.skeleton)
            write_character(path, result.figure, character, bones=bones, make_vrm=vrm)
        case ".usda" | ".usdc" | ".usdz":
            if vrm:
                raise FormatError(path, "", "cannot be a VRM; wanted .vrm", code=Code.OUT_SUFFIX)
            write_usd(path, result.figure, character)
        case ".bvh":
            write_motions(path, character)
        case ".obj" if isinstance(result, Posed):
            write_poses(path, result)
        case ".json":
            write_report(path, result.report)
        case other:
            message = f"cannot hold a result as {other or 'no suffix'}"
            raise FormatError(
                path,
                "",
                f"{message}; wanted .glb .vrm .usdz .usdc .usda .bvh, or .json",
                code=Code.OUT_SUFFIX,
            )


def write_motions(path: Location, character: Character) -> list[Path]:
    """Write a clip as BVH; of several, each into a file with its name; list the files."""
    if not character.clips:
        message = "would be empty: there are no clips; use bunraku animate"
        raise FormatError(path, "", message, code=Code.CLIP_MISSING)
    place, written = Path(path), []
    for clip in character.clips:
        plain = re.sub(r"[^\w.-]+", "_", clip.name)
        alone = len(character.clips) == 1
        own = place if alone else place.with_name(f"{place.stem}-{plain}{place.suffix}")
        write_motion(own, character.skeleton, clip)
        written.append(own)
    return written


def write_poses(path: Location, posed: Posed) -> list[Path]:
    """Write the figure in a pose as OBJ, of several each into its own file; list the files."""
    written = name_poses(path, len(posed.surfaces))
    for name, surface in zip(written, posed.surfaces, strict=True):
        write_mesh(name, surface)
    return written


def name_poses(path: Location, count: int) -> list[Path]:
    """Name the files that so many poses go into, if the user names them `path`."""
    place = Path(path)
    if count == 1 or place.suffix.lower() != ".obj":
        return [place]
    return [place.with_name(f"{place.stem}-{i:03d}{place.suffix}") for i in range(1, count + 1)]


def write_report(path: Location, report: Mapping[str, object]) -> None:
    """Write a report as JSON that a person can read."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n")

"""Writers by suffix, in one step: a file is old, or whole."""

from collections.abc import Mapping
from pathlib import PurePath

from bunraku.errors import Code
from bunraku.formats import gltf
from bunraku.formats.bvh_writing import encode_bvh
from bunraku.formats.files import Location, write_atomically
from bunraku.formats.meshes import encode_obj, encode_ply
from bunraku.formats.usd import USD_SUFFIXES, encode_usd
from bunraku.types import Character, Clip, Figure, FormatError, Mesh, Skeleton


def write_character(
    path: Location,
    figure: Figure,
    character: Character,
    *,
    bones: Mapping[str, int] | None = None,
    make_vrm: bool = False,
) -> None:
    """Write a figure's own document with the character's skeleton, skin and clips, as GLB.

    Args:
        path: ends in .glb or, for a VRM, in .vrm; replaced in one step.
        figure: as `read_figure` gave it.
        character: its mesh has the figure's vertices, in order.
        bones: joint of each bone of a human, by its VRM 1.0 name.
        make_vrm: write a VRM 1.0; the suffix .vrm asks for one too.

    Raises:
        FormatError: if the suffix is another one, or the file cannot be written.
    """
    suffix = PurePath(path).suffix.lower()
    if suffix not in (".glb", ".vrm"):
        message = f"cannot hold a rig as {suffix or 'no suffix'!s}; wanted .glb"
        raise FormatError(path, "", message, code=Code.OUT_SUFFIX)
    asked = make_vrm or suffix == ".vrm"
    content = gltf.encode_character(figure, character, bones=bones, make_vrm=asked)
    write_atomically(path, content)


def write_usd(path: Location, figure: Figure, character: Character) -> None:
    """Write a figure with skeleton, skin and clips as USD.

    Raises:
        FormatError: if the suffix is none of USD's, the extra is missing, or the file cannot be
            written.
    """
    suffix = PurePath(path).suffix.lower()
    if suffix not in USD_SUFFIXES:
        message = f"cannot hold USD as {suffix or 'no suffix'}; wanted {' '.join(USD_SUFFIXES)}"
        raise FormatError(path, "", message, code=Code.OUT_SUFFIX)
    write_atomically(path, encode_usd(figure, character, suffix=suffix))


def write_motion(path: Location, skeleton: Skeleton, clip: Clip) -> None:
    """Write a clip of a skeleton, without a surface, as BVH.

    Raises:
        FormatError: if the suffix is not .bvh, or the file cannot be written.
    """
    suffix = PurePath(path).suffix.lower()
    if suffix != ".bvh":
        message = f"cannot hold a motion as {suffix or 'no suffix'}; wanted .bvh"
        raise FormatError(path, "", message, code=Code.OUT_SUFFIX)
    write_atomically(path, encode_bvh(skeleton, clip))


def write_mesh(path: Location, mesh: Mesh) -> None:
    """Write a mesh alone, vertices in order, as OBJ, PLY or GLB by suffix.

    Raises:
        FormatError: if the suffix is another one, or the file cannot be written.
    """
    suffix = PurePath(path).suffix.lower()
    encoders = {".obj": encode_obj, ".ply": encode_ply, ".glb": gltf.encode_mesh}
    if suffix not in encoders:
        raise FormatError(
            path,
            "",
            f"cannot be written as {suffix or 'no suffix'}; wanted .obj .ply or .glb",
            code=Code.OUT_SUFFIX,
        )
    write_atomically(path, encoders[suffix](mesh))

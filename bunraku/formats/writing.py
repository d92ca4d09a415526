"""Writers by suffix, in one step: a file is old, or whole."""

from pathlib import PurePath

from bunraku.errors import Code
from bunraku.formats import gltf
from bunraku.formats.files import Location, write_atomically
from bunraku.formats.meshes import encode_obj, encode_ply
from bunraku.types import Character, Figure, FormatError, Mesh


def write_character(path: Location, figure: Figure, character: Character) -> None:
    """Write a figure's own document with the character's skeleton, skin and clips, as GLB.

    Args:
        path: ends in .glb; replaced in one step.
        figure: as `read_figure` gave it.
        character: its mesh has the figure's vertices, in order.

    Raises:
        FormatError: if the suffix is another one, or the file cannot be written.
    """
    suffix = PurePath(path).suffix.lower()
    if suffix != ".glb":
        raise FormatError(
            path,
            "",
            f"cannot hold a rig as {suffix or 'no suffix'!s}; wanted .glb",
            code=Code.OUT_SUFFIX,
        )
    write_atomically(path, gltf.encode_character(figure, character))


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

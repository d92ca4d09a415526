"""One reader for every format, chosen by content."""

import logging
from dataclasses import replace

import numpy as np

from bunraku.errors import Code
from bunraku.formats import gltf
from bunraku.formats.axes import check_axes, guess_up, world_from_axes
from bunraku.formats.bvh import read_recording
from bunraku.formats.fbx import convert_to_glb
from bunraku.formats.files import Location, read_bytes
from bunraku.formats.meshes import merge_pieces, read_pieces
from bunraku.formats.pieces import encode_pieces, turn_piece
from bunraku.formats.sniffing import WANTED, sniff
from bunraku.formats.surfaces import check_cloud
from bunraku.types import Character, Clip, Figure, FormatError, Skeleton

logger = logging.getLogger(__name__)


def read_figure(path: Location, *, up: str | None = None, facing: str | None = None) -> Figure:
    """Read the surface of any figure file, told by its content: glTF, OBJ, PLY, STL or OFF.

    Units stay as they are. A rigged file gives its bind geometry, a PLY without faces a point
    cloud. A file that is no glTF becomes one: UVs, normals, colours and materials survive, every
    object, group and material is a piece.

    Args:
        path: the file.
        up: which of its axes is up, y or z; by default Y for glTF, a guess for the others.
        facing: along which of its axes it looks, such as -y; by default +z if y is up, else -y.

    Raises:
        FormatError: if the file cannot be read, is damaged or is of another kind.
    """
    check_axes(path, up, facing)
    content = read_bytes(path)
    kind = sniff(path, content)
    if kind == "bvh":
        raise FormatError(
            path, "", f"is a BVH motion, not a figure; wanted {WANTED}", code=Code.FILE_KIND
        )
    up = up or _up_beside(facing)
    world_from_file = np.eye(4)
    if kind == "fbx":
        kind, content = "gltf", convert_to_glb(path, content)
    if kind == "gltf":
        world_from_file[:3, :3] = world_from_axes(up or "y", facing)
        figure = gltf.read_figure(path, content, world_from_file=world_from_file)
        check_cloud(path, figure.mesh)
        return figure
    pieces, materials = read_pieces(path, content, kind)
    mesh = merge_pieces(pieces)
    check_cloud(path, mesh)
    if up is None:
        up = guess_up(mesh, kind)
        logger.info("%s: %s is taken as up", path, up)
    turn = world_from_axes(up, facing)
    turned = [turn_piece(piece, turn) for piece in pieces]
    world_from_file[:3, :3] = turn
    figure = gltf.read_figure(path, encode_pieces(turned, materials))
    return replace(figure, world_from_file=world_from_file)


def _up_beside(facing: str | None) -> str | None:
    """Tell which axis must be up because the figure looks along the other one."""
    return None if facing is None else {"y": "z", "z": "y"}.get(facing[1])


def read_character(path: Location) -> Character:
    """Read a rigged glTF, GLB or VRM file.

    Returns:
        the character in metres, Y up, rigid joint frames, its mesh in the bind pose, all clips.

    Raises:
        FormatError: if the file cannot be read, is damaged or is not rigged.
    """
    content = read_bytes(path)
    kind = sniff(path, content)
    if kind == "fbx":
        kind, content = "gltf", convert_to_glb(path, content)
    if kind != "gltf":
        raise FormatError(
            path,
            "",
            f"is {kind.upper()}, which holds no rig; wanted a rigged .glb",
            code=Code.FILE_KIND,
        )
    return gltf.read_character(path, content)


def read_motion(path: Location) -> tuple[Skeleton, Clip]:
    """Read a BVH recording: a skeleton in metres, Y up, and its clip.

    Raises:
        FormatError: if the file cannot be read, is damaged or is no BVH.
    """
    content = read_bytes(path)
    kind = sniff(path, content)
    if kind != "bvh":
        raise FormatError(
            path, "", f"is {kind.upper()}, not a BVH motion; wanted a .bvh", code=Code.FILE_KIND
        )
    return read_recording(path, content)

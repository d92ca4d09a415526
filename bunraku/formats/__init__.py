"""The border to files: one reader for every format, chosen by content, and writers by suffix."""

from pathlib import PurePath


from bunraku.formats.bvh import read_recording
from bunraku.formats.files import Location, read_bytes, write_atomically
from bunraku.formats.meshes import encode_obj, encode_ply, merge_pieces, read_pieces
from bunraku.formats.sniffing import FIGURES, sniff
from bunraku.types import Character, Clip, Figure, FormatError, Mesh, Skeleton


def read_figure(path: Location, *, up: str | None = None, facing: str | None = None) -> Figure:
    content = read_bytes(path)
    kind = sniff(path, content)
    pieces, materials = read_pieces(path, content, kind)
    mesh, piece_of = merge_pieces(pieces)
    return Figure(str(path), mesh, piece_of)


def read_motion(path: Location) -> tuple[Skeleton, Clip]:
    content = read_bytes(path)
    kind = sniff(path, content)
    if kind != "bvh":
        raise FormatError(path, "", f"is a {kind} file; wanted a .bvh")
    return read_recording(path, content)

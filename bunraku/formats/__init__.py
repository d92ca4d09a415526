"""The border to files: one reader for every format, chosen by content, and writers by suffix."""

from bunraku.formats.depth_video import is_depth_folder, read_depth
from bunraku.formats.gltf import looks_back, turn_round
from bunraku.formats.inspection import Inspection, inspect
from bunraku.formats.reading import read_character, read_figure, read_motion
from bunraku.formats.writing import write_character, write_mesh, write_motion, write_usd

__all__ = [
    "Inspection",
    "inspect",
    "is_depth_folder",
    "looks_back",
    "read_character",
    "read_depth",
    "read_figure",
    "read_motion",
    "turn_round",
    "write_character",
    "write_mesh",
    "write_motion",
    "write_usd",
]

"""Read and write glTF 2.0, GLB and VRM."""

from bunraku.formats.gltf.character import read_character
from bunraku.formats.gltf.description import describe
from bunraku.formats.gltf.figure import looks_back, read_figure, turn_round
from bunraku.formats.gltf.writing import encode_character, encode_mesh

__all__ = [
    "describe",
    "encode_character",
    "encode_mesh",
    "looks_back",
    "read_character",
    "read_figure",
    "turn_round",
]

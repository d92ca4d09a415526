"""Read and write glTF 2.0, GLB and VRM."""

from bunraku.formats.gltf.character import read_character
from bunraku.formats.gltf.figure import read_figure

__all__ = ["read_character", "read_figure"]

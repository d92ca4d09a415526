"""Read and write glTF 2.0, GLB and VRM."""

from bunraku.formats.gltf.reading import read_figure

__all__ = ["read_figure"]

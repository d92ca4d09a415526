"""Read binary FBX 7: what it holds becomes a glTF document."""

from bunraku.formats.fbx.document import convert_to_glb

__all__ = ["convert_to_glb"]

"""Say what a glTF file holds, after reading all of it."""

from typing import Any

import numpy as np

from bunraku.formats.files import Location
from bunraku.formats.gltf.binding import animated_nodes
from bunraku.formats.gltf.character import build_character
from bunraku.formats.gltf.document import read_document
from bunraku.formats.gltf.figure import build_figure
from bunraku.formats.gltf.geometry import read_blocks
from bunraku.formats.gltf.tree import build_tree
from bunraku.types import Clip


def describe(path: Location, content: bytes | None = None) -> dict[str, Any]:
    """Read a glTF file whole, and count what is in it.

    Args:
        path: the file.
        content: its bytes, if they are known already.

    Returns:
        meshes, primitives, vertices, faces, materials, textures, skins (joints of each), joints,
        clips (name, seconds, frames), height, extensions_used, extensions_required and warnings.

    Raises:
        FormatError: if any part of it cannot be trusted.
    """
    document = read_document(path, content)
    gltf, tree = document.gltf, build_tree(document)
    blocks = read_blocks(document, tree)
    clips: tuple[Clip, ...] = ()
    height, joints = 0.0, 0
    if gltf.skins or animated_nodes(document):
        character = build_character(document, tree, blocks)
        clips, joints = character.clips, len(character.skeleton.names)
    if blocks:
        height = float(np.ptp(build_figure(document, tree, blocks).mesh.vertices[:, 1]))
    return {
        "meshes": len(gltf.meshes),
        "primitives": sum(len(mesh.primitives) for mesh in gltf.meshes),
        "vertices": sum(len(block.vertices) for block in blocks),
        "faces": sum(len(block.faces) for block in blocks),
        "materials": len(gltf.materials),
        "textures": len(gltf.images),
        "skins": [len(skin.joints) for skin in gltf.skins],
        "joints": joints,
        "clips": [(clip.name, float(np.ptp(clip.times)), len(clip.times)) for clip in clips],
        "height": height,
        "extensions_used": gltf.extensions_used,
        "extensions_required": gltf.extensions_required,
        "warnings": document.warnings,
    }

"""Say what a glTF file holds, after reading all of it."""

from typing import Any

import numpy as np

from bunraku.formats.files import Location
from bunraku.formats.gltf.binding import animated_nodes
from bunraku.formats.gltf.character import Rig, build_rig
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.draco import read_unpacked
from bunraku.formats.gltf.figure import build_figure
from bunraku.formats.gltf.geometry import Block, read_blocks
from bunraku.formats.gltf.tree import Tree, build_tree

SAME_PLACE = 1e-3  # of the longest extent: joints so near to where their nodes stand did not move


def describe(path: Location, content: bytes | None = None) -> dict[str, Any]:
    """Read a glTF file whole, and count what is in it.

    Args:
        path: the file.
        content: its bytes, if they are known already.

    Returns:
        mesh (in the bind pose; nothing if none is shown), is_placeholder (no position of it is
        stored), meshes, primitives, materials, textures, skins (joints of each), joints, places (of
        the joints), bind (see `name_bind`), clips (name, seconds, frames), facing, extensions_used
        and extensions_required.

    Raises:
        FormatError: if any part of it cannot be trusted.
    """
    document = read_unpacked(path, content)
    gltf, tree = document.gltf, build_tree(document)
    blocks = read_blocks(document, tree)
    rig = None
    if gltf.skins or animated_nodes(document):
        rig = build_rig(document, tree, blocks)
    clips = rig.clips if rig else ()
    return {
        "mesh": build_figure(document, tree, blocks).mesh if blocks else None,
        "is_placeholder": _is_placeholder(document, blocks),
        "meshes": len(gltf.meshes),
        "primitives": sum(len(mesh.primitives) for mesh in gltf.meshes),
        "materials": len(gltf.materials),
        "textures": len(gltf.images),
        "skins": [len(skin.joints) for skin in gltf.skins],
        "joints": len(rig.nodes) if rig else 0,
        "places": rig.rest[:, :3, 3] if rig else None,
        "bind": name_bind(document, tree, rig) if rig else "",
        "clips": [(clip.name, float(np.ptp(clip.times)), len(clip.times)) for clip in clips],
        "facing": "-z" if "VRM" in gltf.extensions_used else "+z",  # VRM 0 looks back by definition
        "extensions_used": gltf.extensions_used,
        "extensions_required": gltf.extensions_required,
    }


def _is_placeholder(document: Document, blocks: list[Block]) -> bool:
    """Tell that no position is stored in the file: zeros, which glTF takes for them, are shown."""
    gltf, used = document.gltf, list[int]()
    for block in blocks:
        mesh = gltf.nodes[block.node].mesh
        assert mesh is not None
        used.append(gltf.meshes[mesh].primitives[block.primitives[0]].attributes["POSITION"])
    return bool(used) and all(gltf.accessors[index].is_placeholder for index in used)


def name_bind(document: Document, tree: Tree, rig: Rig) -> str:
    """Say where the pose comes from in which the meshes were bound.

    Returns:
        nodes: no skin, meshes hang on joints; identity: skins without inverse bind matrices;
        same: inverse bind matrices, joints where the nodes stand; own: joints elsewhere.
    """
    used = {node.skin for node in document.gltf.nodes if node.skin is not None}
    skins = [document.gltf.skins[skin] for skin in sorted(used)] or document.gltf.skins
    if not skins:
        return "nodes"
    if all(skin.inverse_bind_matrices is None for skin in skins):
        return "identity"
    joints = list({node for skin in skins for node in skin.joints} & rig.binding.bind.keys())
    bound = np.stack([rig.binding.bind[node] for node in joints])
    extent = float(np.ptp(bound[:, :3, 3], axis=0).max()) or 1.0
    gap = np.abs(bound - tree.world[joints])
    moved = gap[:, :3, 3].max() > SAME_PLACE * extent
    size = np.abs(bound[:, :3, :3]).max()
    turned = gap[:, :3, :3].max() > 0.01 * size
    return "own" if moved or turned else "same"

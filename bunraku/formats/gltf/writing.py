"""Write GLB files: a character into its figure's own document, or a mesh alone."""

from collections.abc import Mapping
from pathlib import PurePath

import numpy as np
from jaxtyping import Int

from bunraku.errors import Code
from bunraku.formats.gltf.animating import add_clip
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.draft import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Draft, draft_document
from bunraku.formats.gltf.figure import FigureDocument, read_figure
from bunraku.formats.gltf.humanoid import add_vrm, is_vrm, missing_bones, rename_bones
from bunraku.formats.gltf.rigging import add_skeleton, add_skins, add_weights
from bunraku.formats.gltf.unrigging import remove_rig
from bunraku.types import Character, Figure, Mesh

POINTS, TRIANGLES = 0, 4


def encode_character(
    figure: Figure,
    character: Character,
    *,
    bones: Mapping[str, int] | None = None,
    make_vrm: bool = False,
) -> bytes:
    """Put a skeleton, a skin and clips into the figure's own document; nothing else changes.

    Meshes, materials, textures, UVs, morph targets, names, extras and extensions stay byte for
    byte. A rig that the file had already is replaced. Files beside a .gltf come into the GLB.

    Args:
        figure: as it was read.
        character: its mesh has the figure's vertices, in order, in the pose of the file.
        bones: joint of each bone of a human, by its VRM 1.0 name; without, a VRM stays as found.
        make_vrm: write a VRM 1.0; a figure that is a VRM stays what it is.

    Returns:
        the bytes of a GLB file, the same for the same input.

    Raises:
        ValueError: if the character's mesh is not the figure's, or bones are missing for a VRM.
    """
    count = len(figure.mesh.vertices)
    if len(character.mesh.vertices) != count:
        message = f"the character has {len(character.mesh.vertices)} vertices, the figure {count}"
        raise ValueError(f"{message}; bind the figure's own mesh")
    found = figure.document
    if not isinstance(found, FigureDocument):
        found = read_figure(figure.path, encode_mesh(figure.mesh)).document
    assert isinstance(found, FigureDocument)
    draft = draft_document(found.document)
    shown = {block.node for block in found.blocks}
    remove_rig(found.document, found.tree, draft, shown=shown)
    joints = add_skeleton(
        draft,
        character.skeleton,
        name=f"{PurePath(figure.path).stem}_rig",
        file_from_world=np.linalg.inv(found.world_from_file),
    )
    add_skins(draft, found, character, joints=joints)
    add_weights(draft, found, character.skin.weights)
    for clip in character.clips:
        add_clip(draft, clip, character.skeleton, joints=joints)
    if bones is not None or make_vrm:
        named = {name: joints[joint] for name, joint in (bones or {}).items()}
        _settle_vrm(found.document, draft, named, make_vrm=make_vrm)
    return draft.encode()


def _settle_vrm(
    document: Document, draft: Draft, bones: Mapping[str, int], *, make_vrm: bool
) -> None:
    """Keep a VRM right, or make one if that is asked for."""
    missing = missing_bones(bones)
    if make_vrm and missing:
        message = f"a VRM wants {', '.join(missing[:4])}, which the performance has not"
        raise ValueError(f"{message}; choose a human performance, or write a plain .glb")
    if make_vrm and not is_vrm(draft.json):
        add_vrm(draft, bones, path=document.path)
    old = {node for skin in document.gltf.skins for node in skin.joints}
    for message in rename_bones(draft, bones, old=old):
        document.warn("/extensions", message, code=Code.RIG_VRM)


def encode_mesh(mesh: Mesh) -> bytes:
    """Write a mesh alone as a GLB; without faces, as points."""
    json = {"asset": {"version": "2.0", "generator": "bunraku"}, "scene": 0}
    draft = Draft(json, bytearray())
    vertices = mesh.vertices.astype(np.float32)
    position = draft.add_array(vertices, "VEC3", target=ARRAY_BUFFER)
    draft.add_bounds(position, vertices)
    primitive = {"attributes": {"POSITION": position}, "mode": POINTS}
    if len(mesh.faces):
        primitive |= {"indices": add_indices(draft, mesh.faces), "mode": TRIANGLES}
    draft.append("meshes", {"primitives": [primitive]})
    draft.append("nodes", {"mesh": 0})
    draft.append("scenes", {"nodes": [0]})
    return draft.encode()


def add_indices(draft: Draft, faces: Int[np.ndarray, "faces 3"]) -> int:
    """Add the corners of triangles, in two bytes each where that is enough."""
    kind = np.dtype("<u2") if faces.max() < 65535 else np.dtype("<u4")
    corners = faces.reshape(-1, 1).astype(kind)
    return draft.add_array(corners, "SCALAR", target=ELEMENT_ARRAY_BUFFER)

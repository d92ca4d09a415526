"""Take the old rig out of a draft; whatever else there is stays where it is.

Old joints stay in the list of nodes, so that no index changes its meaning, but those that
served nothing but the rig are no longer shown.
"""

from typing import Any

from bunraku.formats.gltf.binding import MOVING_PATHS
from bunraku.formats.gltf.document import Document
from bunraku.formats.gltf.draft import Draft
from bunraku.formats.gltf.tree import Tree
from bunraku.types import NO_PARENT

NAMES_NODES = ("VRM", "KHR_animation_pointer", "MSFT_lod")  # extensions that refer to nodes


def remove_rig(document: Document, tree: Tree, draft: Draft, *, shown: set[int]) -> None:
    """Remove skins, weights, and the motion of old joints and of the nodes of the figure.

    Args:
        document: the file as it was found.
        tree: its nodes.
        draft: what is changed.
        shown: nodes of the figure's meshes.
    """
    joints = {node for skin in document.gltf.skins for node in skin.joints}
    draft.json.pop("skins", None)
    for node in draft.json.get("nodes", []):
        node.pop("skin", None)
    for mesh in draft.json.get("meshes", []):
        for primitive in mesh["primitives"]:
            names = primitive["attributes"]
            for name in [n for n in names if n.startswith(("JOINTS_", "WEIGHTS_"))]:
                del names[name]
    driven = {step for node in joints | shown for step in tree.ancestors(node)}
    _remove_motion(draft.json, driven)
    _hide_joints(document, tree, draft.json, joints=joints)


def _remove_motion(json: dict[str, Any], driven: set[int]) -> None:
    """Drop the channels that move these nodes, and clips that have no others."""
    kept = []
    for clip in json.get("animations", []):
        channels = [
            channel
            for channel in clip.get("channels", [])
            if channel["target"]["path"] not in MOVING_PATHS
            or channel["target"].get("node") not in driven
        ]
        if channels and len(channels) < len(clip["channels"]):
            used = sorted({channel["sampler"] for channel in channels})
            clip["samplers"] = [clip["samplers"][sampler] for sampler in used]
            for channel in channels:
                channel["sampler"] = used.index(channel["sampler"])
            clip["channels"] = channels
        if channels:
            kept.append(clip)
    if kept:
        json["animations"] = kept
    else:
        json.pop("animations", None)


def _hide_joints(document: Document, tree: Tree, json: dict[str, Any], *, joints: set[int]) -> None:
    """Take joints out of the scene that nothing hangs on."""
    used = json.get("extensionsUsed", [])
    if any(name.startswith(NAMES_NODES) for name in used):
        return
    clips = json.get("animations", [])
    moved = {c["target"].get("node") for clip in clips for c in clip["channels"]}
    idle: set[int] = set()
    for node in reversed(tree.order):
        children = document.gltf.nodes[node].children
        bare = not json["nodes"][node].keys() & {"mesh", "camera", "extensions", "extras"}
        if node in joints and bare and node not in moved and idle.issuperset(children):
            idle.add(node)
    tops = {node for node in idle if int(tree.parents[node]) not in idle}
    parents = {int(tree.parents[node]) for node in tops} - {NO_PARENT}
    for owner, key in [(json["nodes"][node], "children") for node in sorted(parents)] + [
        (scene, "nodes") for scene in json.get("scenes", []) if "nodes" in scene
    ]:
        owner[key] = [node for node in owner[key] if node not in tops]
        if not owner[key]:
            del owner[key]

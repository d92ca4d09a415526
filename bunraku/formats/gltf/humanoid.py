"""VRM: which joints are which bones of a human, in files that say so or shall.

A figure that is a VRM already, 0.x or 1.0, stays one: its bones become the new joints, and springs
(hair, skirts) that moved old joints go with these.
"""

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from bunraku.formats.gltf.draft import Draft

REQUIRED = (
    *("hips", "spine", "head"),
    *(
        f"{side}{limb}{part}"
        for side in ("left", "right")
        for limb, parts in (("Upper", ("Leg", "Arm")), ("Lower", ("Leg", "Arm")))
        for part in parts
    ),
    *(f"{side}{end}" for side in ("left", "right") for end in ("Foot", "Hand")),
)  # by VRM 1.0
OLDER_NAMES = {
    f"{side}Thumb{new}": f"{side}Thumb{old}"
    for side in ("left", "right")
    for new, old in (("Metacarpal", "Proximal"), ("Proximal", "Intermediate"))
}  # of VRM 0.x
LICENCE = "https://vrm.dev/licenses/1.0/"
ONE, ZERO, SPRINGS = "VRMC_vrm", "VRM", "VRMC_springBone"


def is_vrm(json: Mapping[str, Any]) -> bool:
    """Tell whether a document names the bones of a human."""
    return not {ONE, ZERO}.isdisjoint(json.get("extensions", {}))


def missing_bones(bones: Mapping[str, int]) -> list[str]:
    """List the bones that VRM wants and that are not there."""
    return [name for name in REQUIRED if name not in bones]


def rename_bones(draft: Draft, bones: Mapping[str, int], *, old: set[int]) -> list[str]:
    """Let the bones of a VRM be the new joints, or make it a plain glTF if some are missing.

    Args:
        draft: what is changed.
        bones: node of each bone, by its VRM 1.0 name.
        old: nodes that were joints and move nothing any more.

    Returns:
        what was left out, in plain words.
    """
    if not is_vrm(draft.json):
        return []
    missing = missing_bones(bones)
    if missing:
        for name in (ONE, ZERO, SPRINGS):
            _drop(draft.json, name)
        return [f"is no VRM any more: the performance has no {', '.join(missing[:4])}"]
    lost = 0
    extensions = draft.json["extensions"]
    if ONE in extensions:
        extensions[ONE]["humanoid"] = {"humanBones": _describe(bones)}
        lost += _prune(extensions.get(SPRINGS, {}), "springs", old)
        if SPRINGS in extensions and not extensions[SPRINGS].get("springs"):
            _drop(draft.json, SPRINGS)
    if ZERO in extensions:
        lost += _rename_older(extensions[ZERO], bones, old)
    return [f"{lost} spring chains of the old rig are left out"] if lost else []


def add_vrm(draft: Draft, bones: Mapping[str, int], *, path: str) -> None:
    """Make a document a VRM 1.0 of unknown authors, with the strictest licence there is.

    Args:
        draft: what is changed.
        bones: node of each bone; those that VRM wants are there.
        path: of the figure, which gives the name.
    """
    meta = {"name": PurePath(path).stem, "authors": ["unknown"], "licenseUrl": LICENCE}
    vrm = {"specVersion": "1.0", "meta": meta, "humanoid": {"humanBones": _describe(bones)}}
    draft.json.setdefault("extensions", {})[ONE] = vrm
    used = draft.json.setdefault("extensionsUsed", [])
    if ONE not in used:
        used.append(ONE)


def _describe(bones: Mapping[str, int]) -> dict[str, dict[str, int]]:
    return {name: {"node": node} for name, node in bones.items()}


def _rename_older(vrm: dict[str, Any], bones: Mapping[str, int], old: set[int]) -> int:
    """Do the same for VRM 0.x; give the number of springs left out."""
    vrm["humanoid"] = vrm.get("humanoid", {}) | {
        "humanBones": [
            {"bone": OLDER_NAMES.get(name, name), "node": node, "useDefaultValues": True}
            for name, node in bones.items()
        ]
    }
    if "firstPerson" in vrm:
        vrm["firstPerson"]["firstPersonBone"] = bones["head"]
    return _prune(vrm.get("secondaryAnimation", {}), "boneGroups", old)


def _prune(springs: dict[str, Any], key: str, old: set[int]) -> int:
    """Leave out the springs that move old joints; give their number."""
    chains = springs.get(key, [])
    kept = [chain for chain in chains if old.isdisjoint(_nodes(chain))]
    if key in springs:
        springs[key] = kept
    return len(chains) - len(kept)


def _nodes(chain: Mapping[str, Any]) -> set[int]:
    """List the nodes that a spring of either version moves."""
    return {*chain.get("bones", ()), *(joint.get("node") for joint in chain.get("joints", ()))}


def _drop(json: dict[str, Any], name: str) -> None:
    """Take an extension out of a document."""
    json.get("extensions", {}).pop(name, None)
    for key in ("extensionsUsed", "extensionsRequired"):
        if name in json.get(key, []):
            json[key].remove(name)
            if not json[key]:
                del json[key]
    if json.get("extensions") == {}:
        del json["extensions"]

"""The JSON of a glTF document: bounded, typed, and repaired where that is safe."""

import json as plain_json
import re
from collections import Counter
from typing import Any

import msgspec

from bunraku.errors import Code, announce
from bunraku.formats.gltf.schema import Gltf
from bunraku.types import FormatError


def parse_json(path: str, json: bytes) -> tuple[bytes, Gltf]:
    """Read a document, and mend what can have one meaning only.

    Whole numbers that are written with a fraction of zero become integers. Meshes that no node
    shows get a node each, if there are no others.

    Args:
        path: the file, for messages.
        json: as it is in the file.

    Returns:
        the JSON, mended or as it was, and the same typed.

    Raises:
        FormatError: with a JSON pointer, if it is no JSON or breaks the schema.
    """
    try:
        raw = msgspec.json.decode(json)
        if not isinstance(raw, dict):
            raise FormatError(path, "", "JSON must be an object", code=Code.GLTF_JSON)
        if b"null" in json:
            _refuse_null(path, raw)
        _refuse_doubled(path, json)
        gltf, mended = _convert(raw)
    except FormatError:
        raise
    except (RecursionError, ValueError) as problem:
        raise _trouble(path, problem) from None
    mended = _check_version(path, gltf, raw) or mended
    if all(node.mesh is None for node in gltf.nodes) and _stores_positions(gltf):
        message = f"no node shows a mesh; each of the {len(gltf.meshes)} is given one"
        announce(path, message, code=Code.GLTF_UNSHOWN, where="/nodes")
        mended = _show_meshes(mended or raw, len(gltf.meshes))
        gltf = msgspec.convert(mended, Gltf)
    return (msgspec.json.encode(mended) if mended else json), gltf


def _check_version(path: str, gltf: Gltf, raw: dict[str, Any]) -> dict[str, Any] | None:
    """Refuse other versions than 2; give the document mended if its version is a number."""
    version = gltf.asset.version
    if not re.match(r"2(\.|$)", str(version)):
        message = f"glTF version {str(version)[:20]!r}; only 2 is read, export it again"
        raise FormatError(path, "/asset/version", message, code=Code.GLTF_VERSION)
    if isinstance(version, str):
        return None
    message = f"the version is the number {version}, wanted a text; taken as '2.0'"
    announce(path, message, code=Code.GLTF_SCHEMA, where="/asset/version")
    return _with_integers(raw) | {"asset": raw["asset"] | {"version": "2.0"}}


def _trouble(path: str, problem: Exception) -> FormatError:
    """Say where a document breaks off, or breaks the schema."""
    match problem:
        case msgspec.ValidationError():
            message, _, place = str(problem).partition(" - at ")
            message = f"{message.replace('`', chr(39))}; export the file again"
            return FormatError(path, _pointer(place), message, code=Code.GLTF_SCHEMA)
        case RecursionError():
            message = "JSON is nested too deeply; export the file again"
        case _:
            message = f"JSON is damaged: {problem}; export the file again"
    return FormatError(path, "", message, code=Code.GLTF_JSON)


def _convert(raw: dict[str, Any]) -> tuple[Gltf, dict[str, Any] | None]:
    """Give a document typed, and itself if whole numbers had to be written as such."""
    try:
        return msgspec.convert(raw, Gltf), None
    except msgspec.ValidationError:
        whole = _with_integers(raw)
        return msgspec.convert(whole, Gltf), whole


def _with_integers(value: Any) -> Any:
    """Write numbers such as 3.0 as 3; a float may be an integer, an index must."""
    if isinstance(value, dict):
        return {key: _with_integers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_with_integers(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _stores_positions(gltf: Gltf) -> bool:
    """Tell whether any mesh is worth being shown: its positions are no mere placeholder."""
    for primitive in (primitive for mesh in gltf.meshes for primitive in mesh.primitives):
        index = primitive.attributes.get("POSITION")
        if index is not None and (
            primitive.extensions.draco is not None  # where they are is checked later
            or index >= len(gltf.accessors)
            or not gltf.accessors[index].is_placeholder
        ):
            return True
    return False


def _show_meshes(raw: dict[str, Any], count: int) -> dict[str, Any]:
    """Give each mesh a node in the default scene."""
    nodes = raw.get("nodes", [])
    added = list(range(len(nodes), len(nodes) + count))
    scenes = [dict(scene) for scene in raw.get("scenes", [])] or [{}]
    shown = raw.get("scene", 0)
    if shown < len(scenes):
        scenes[shown]["nodes"] = scenes[shown].get("nodes", []) + added
    nodes = nodes + [{"mesh": mesh} for mesh in range(count)]
    return raw | {"nodes": nodes, "scenes": scenes, "scene": shown}


def _pointer(place: str) -> str:
    """Turn msgspec's `$.nodes[3].mesh` into the JSON pointer /nodes/3/mesh."""
    steps: list[str] = re.findall(r"[^.\[\]`$]+", place.replace("[...]", ""))
    return "".join(f"/{step}" for step in steps)


def _refuse_null(path: str, raw: dict[str, Any]) -> None:
    """Refuse null wherever the specification has no place for it."""
    waiting: list[tuple[str, Any]] = [("", raw)]
    while waiting:
        where, value = waiting.pop()
        if value is None:
            message = "null is not allowed here; leave the property out"
            raise FormatError(path, where, message, code=Code.GLTF_SCHEMA)
        if isinstance(value, dict):
            free = {"extras", "extensions"}
            waiting += [(f"{where}/{key}", item) for key, item in value.items() if key not in free]
        elif isinstance(value, list):
            waiting += [(f"{where}/{i}", item) for i, item in enumerate(value)]


def _refuse_doubled(path: str, json: bytes) -> None:
    """Refuse a key that is twice in one object: which of the two counts, no two readers agree."""

    def check(pairs: list[tuple[str, Any]]) -> None:
        if len({key for key, _ in pairs}) < len(pairs):
            again, _ = Counter(key for key, _ in pairs).most_common(1)[0]
            message = f"key {again[:40]!r} is twice in one object; remove one"
            raise FormatError(path, "", message, code=Code.GLTF_JSON)

    plain_json.loads(json, object_pairs_hook=check)

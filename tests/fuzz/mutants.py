"""Small sound files of every format, and ways to damage them that respect their structure.

A mutation of random bytes mostly dies at the first check. These change one number, line, JSON
value, chunk length or array element at a time, so that what is damaged gets far into a reader.
"""

import json
import struct
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from bunraku.formats.fbx.records import MAGIC, Packed, Record, read_records, unpack
from bunraku.formats.meshes import encode_obj, encode_ply
from bunraku.types import Character, Clip, FormatError, Mesh, Skeleton, Skin
from tests.formats.made_fbx import Maker, Node, encode, properties
from tests.formats.made_gltf import Made

Generator = np.random.Generator
NUMBERS = (
    *(0, -0.0, 1, -1, 2, 3, 7, 127, 128, 255, 256, 65535, 65536, 2**31 - 1, 2**31, 2**32, 2**63),
    *(-(2**31), 10**30, 0.5, 1e-30, 1e30, 1e38, -1e38, 1e300, 1e400, 5_000_001, 100_001, 4097),
)
WORDS = (
    *("nan", "inf", "-inf", "1e400", "", "x", "\0", "-", "1_0", "0x10", "1.5.2", "٣", "1,5"),
    *("#", "/", "//", "1//", "/1", "1/1/1/1", "\\", "{", "}", "End", "v", "f", "element", "list"),
)
VALUES: tuple[Any, ...] = (None, True, False, "x", "", [], {}, [[]], {"a": 1}, "../x", "data:,", -1)
NODE_COUNT = 4
BLUNT = 0.15  # share of mutations that know no structure


def cube() -> Mesh:
    """Twelve triangles around a box that is no cube, so that axes differ."""
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 3.0) for z in (0.0, 2.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]))


def make_rigged() -> Made:
    """A skinned box with two joints, a clip of every interpolation, a picture and sparse data."""
    made, box = Made(), cube()
    joints = np.zeros((8, 4), int)
    joints[:, 0] = box.vertices[:, 1] > 1
    shares = np.tile([1.0, 0, 0, 0], (8, 1))
    primitive = made.primitive(box.vertices, box.faces, **made.weights(joints, shares))
    made.add("meshes", primitives=[primitive], name="box")
    made.add("nodes", name="root", children=[1, 2])
    made.add("nodes", name="hips", children=[3], translation=[0, 0.5, 0])
    made.add("nodes", name="box", mesh=0, skin=made.skin([1, 3], np.tile(np.eye(4), (2, 1, 1))))
    made.add("nodes", name="chest", rotation=[0, 0, 0, 1], scale=[1, 1, 1])
    made.add("scenes", nodes=[0])
    made.json["scene"] = 0
    turn = [[0, 0, 0, 1.0], [0, 0, 0.6, 0.8]]
    spline = np.zeros((6, 3))
    made.clip(
        "wave",
        (1, "rotation", [0, 1], turn, "LINEAR"),
        (3, "translation", [0, 1], spline, "CUBICSPLINE"),
        (3, "scale", [0, 1], np.ones((2, 3)), "STEP"),
    )
    picture = b"\x89PNG\r\n\x1a\n" + struct.pack(
        ">I4sIIBBBBBI", 13, b"IHDR", 2, 2, 8, 2, 0, 0, 0, 0
    )
    made.add("images", bufferView=made.view(picture), mimeType="image/png")
    return made


def make_fbx() -> list[Node]:
    """A skinned box with two joints, an arc of a clip, axes and units of its own."""
    box, rest = cube(), np.tile(np.eye(4), (2, 1, 1))
    rest[1, 1, 3] = 1.5
    weights = np.eye(2)[(box.vertices[:, 1] > 1).astype(int)]
    inverse_bind = np.tile(np.eye(4), (2, 1, 1))
    inverse_bind[1, 1, 3] = -1.5
    turns = np.tile([0.0, 0, 0, 1], (2, 2, 1))
    turns[1, 1] = 0, 0, 0.6, 0.8
    still = np.zeros((2, 2, 3)) + rest[:, :3, 3]
    clip = Clip("wave", np.array([0.0, 0.1]), still, turns, np.ones((2, 2, 3)))
    skeleton = Skeleton(("hips", "chest"), np.array([-1, 0]), rest)
    character = Character(box, skeleton, Skin(weights, inverse_bind), (clip,))
    settings = Node("GlobalSettings")
    properties(settings, UpAxis=1, FrontAxis=2, CoordAxis=0, UnitScaleFactor=1.0, TimeMode=6)
    definitions = Node("Definitions")
    template = definitions.add("ObjectType", "Model").add("PropertyTemplate", "FbxNode")
    properties(template, Lcl_Scaling=[1.0, 1.0, 1.0])
    maker = Maker(character, before=(10.0, 0.0, 0.0), pivot=(0.0, 1.0, 0.0))
    objects, links = maker.make()
    return [settings, definitions, objects, links]


def make_seeds() -> dict[str, list[bytes]]:
    """Give a few sound files of each format."""
    box = cube()
    text = encode_obj(box).decode()
    coloured = text.replace("f ", "usemtl red\ng part\nvt 0 0\nvn 0 0 1\nf ", 1)
    header = "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
    header += (
        "property float z\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = [" ".join(map(str, row)) for row in box.vertices.tolist()]
    faces = ["3 " + " ".join(map(str, face)) for face in box.faces.tolist()]
    triangles = box.vertices[box.faces].astype("<f4")
    records = b"".join(bytes(12) + t.tobytes() + bytes(2) for t in triangles)
    solid = ["solid box"]
    for corners in triangles.tolist():
        solid += ["facet normal 0 0 1", "outer loop"]
        solid += [f"vertex {x} {y} {z}" for x, y, z in corners] + ["endloop", "endfacet"]
    rigged = make_rigged()
    return {
        "obj": [text.encode(), coloured.encode()],
        "ply": [encode_ply(box), (header + "\n".join([*rows, *faces, ""])).encode()],
        "stl": [
            bytes(80) + struct.pack("<I", 12) + records,
            "\n".join([*solid, "endsolid"]).encode(),
        ],
        "off": ["\n".join(["OFF", "8 12 0", *rows, *faces, ""]).encode()],
        "bvh": [BVH.encode()],
        "glb": [rigged.glb()],
        "fbx": [encode(make_fbx()), encode(make_fbx(), version=7500, packed=False)],
    }


BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Knee
  {
    OFFSET 0 -90 0
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 0 -90 10
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 180 2 0 0 0 0 0 0
1 180 2 90 0 0 0 0 90
"""


def mutate(content: bytes, rng: Generator) -> bytes:
    """Damage a file once to four times."""
    times = int(rng.integers(1, 5))
    if content.startswith(MAGIC) and rng.random() > BLUNT:
        return _mutate_fbx(content, rng, times=times)
    for _ in range(times):
        content = _choose_mutation(content, rng)(content, rng) or b"\n"
    return content


def _choose_mutation(content: bytes, rng: Generator) -> Callable[[bytes, Generator], bytes]:
    """Prefer what goes deep into a file of this kind."""
    if rng.random() < BLUNT or content.startswith(MAGIC):
        return _mutate_bytes
    if content.startswith(b"glTF"):
        return _mutate_glb
    return _mutate_text if b"\0" not in content[:64] or content[:3] == b"ply" else _mutate_arrays


def _mutate_bytes(content: bytes, rng: Generator) -> bytes:
    """Cut, repeat or change a few bytes anywhere."""
    start, end = sorted(rng.integers(0, len(content) + 1, 2))
    match int(rng.integers(4)):
        case 0:
            return content[:start]
        case 1:
            return content[:start] + content[end:]
        case 2:
            return content[:end] + content[start:]
    changed = bytearray(content)
    for place in rng.integers(0, len(content), int(rng.integers(1, 5))):
        changed[place] = int(rng.integers(256))
    return bytes(changed)


def _mutate_arrays(content: bytes, rng: Generator) -> bytes:
    """Overwrite an aligned word with a number that means something else."""
    if len(content) < 8:
        return content
    number = NUMBERS[int(rng.integers(len(NUMBERS)))]
    with np.errstate(over="ignore"):
        word = np.float32(number).tobytes()
    if rng.random() < 0.5 and abs(number) < 2**32:
        word = struct.pack("<I", int(number) % 2**32)
    elif rng.random() < 0.3:
        word = np.float32(np.nan).tobytes()
    place = int(rng.integers(0, len(content) // 4)) * 4
    return content[:place] + word + content[place + 4 :]


def _mutate_text(content: bytes, rng: Generator) -> bytes:
    """Change a word or a line of text; of a binary PLY, of its header."""
    text, mark, rest = content.partition(b"end_header\n")
    if mark and rng.random() < 0.4 and b"binary" in text:
        return text + mark + _mutate_arrays(rest, rng)
    lines = (text if mark and b"binary" in text else content).split(b"\n")
    tail = mark + rest if mark and b"binary" in text else b""
    line = int(rng.integers(len(lines)))
    match int(rng.integers(6)):
        case 0:
            del lines[line]
        case 1:
            lines.insert(line, lines[int(rng.integers(len(lines)))])
        case 2:
            other = int(rng.integers(len(lines)))
            lines[line], lines[other] = lines[other], lines[line]
        case _:
            lines[line] = _mutate_words(lines[line], rng)
    return b"\n".join(lines) + tail


def _mutate_words(line: bytes, rng: Generator) -> bytes:
    """Replace, drop or double a word."""
    words = line.split(b" ")
    place = int(rng.integers(len(words)))
    match int(rng.integers(5)):
        case 0:
            del words[place]
        case 1:
            words.insert(place, words[place])
        case 2:
            words[place] = WORDS[int(rng.integers(len(WORDS)))].encode()
        case _:
            words[place] = str(NUMBERS[int(rng.integers(len(NUMBERS)))]).encode()
    return b" ".join(words)


def _mutate_glb(content: bytes, rng: Generator) -> bytes:
    """Change a value of the JSON, an element of the arrays or a field of the container."""
    if rng.random() < 0.05 or len(content) < 28:
        return _mutate_arrays(content, rng)
    length = struct.unpack_from("<I", content, 12)[0]
    text, rest = content[20 : 20 + length], content[20 + length :]
    try:
        document = json.loads(text)
    except ValueError:
        return _mutate_bytes(content, rng)
    if rng.random() < 0.25 and len(rest) > 16:
        rest = rest[:8] + _mutate_arrays(rest[8:], rng)
    else:
        mutate_json(document, rng)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I", len(text)) + b"JSON" + text + rest
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


@lru_cache(maxsize=8)
def _read_seed(content: bytes) -> Record | None:
    """Read the records of a file that is damaged often; nothing if they are damaged already."""
    try:
        return read_records("seed.fbx", content)
    except FormatError:
        return None


def _mutate_fbx(content: bytes, rng: Generator, *, times: int) -> bytes:
    """Change values, elements of arrays or records of an FBX file."""
    root = _read_seed(content)
    if root is None:
        return _mutate_arrays(content, rng)
    records = [_as_node(record) for record in root.inside]
    for _ in range(times):
        _change_record(records, rng)
    return encode(records, version=int.from_bytes(content[23:27], "little"), packed=True)


def _change_record(records: list[Node], rng: Generator) -> None:
    """Drop, double, rename or refill a record, or change one of its values."""
    places = list[tuple[list[Node], int]]()
    waiting = [records]
    while waiting:
        owner = waiting.pop()
        places += [(owner, place) for place in range(len(owner))]
        waiting += [node.inside for node in owner]
    if not places:
        return
    owner, place = places[int(rng.integers(len(places)))]
    other, its = places[int(rng.integers(len(places)))]
    node = owner[place]
    match int(rng.integers(8)):
        case 0:
            del owner[place]
        case 1:
            owner.insert(place, _as_node(other[its]))
        case 2:
            node.name = other[its].name
        case 3:
            node.values = other[its].values
        case _:
            node.values = _mutate_values(node.values, rng)


def _as_node(record: Record | Node) -> Node:
    """Copy a record, so that it can be changed."""
    return Node(record.name, record.values, [_as_node(inner) for inner in record.inside])


def _mutate_values(values: tuple[Any, ...], rng: Generator) -> tuple[Any, ...]:
    """Change one value, or one element of an array."""
    if not values:
        return (int(rng.integers(4)),)
    changed, place = list(values), int(rng.integers(len(values)))
    number = NUMBERS[int(rng.integers(len(NUMBERS)))]
    match changed[place]:
        case Packed() | np.ndarray() as numbers:
            try:
                plain = unpack("", "", numbers) if isinstance(numbers, Packed) else numbers
                array = plain.copy()
            except FormatError:
                return ()
            with np.errstate(all="ignore"):
                if rng.random() < 0.3:
                    array = array[: int(rng.integers(len(array) + 1))]
                elif len(array):
                    element = np.array(number, np.float64).astype(array.dtype)
                    array[int(rng.integers(len(array)))] = element
            changed[place] = array
        case bool() | str() | bytes():
            changed[place] = (number, "", "x", True, b"\0")[int(rng.integers(5))]
        case float():
            changed[place] = (float(number), float("nan"))[int(rng.random() < 0.2)]
        case _:
            changed[place] = int(number) if abs(number) < 2**63 else int(rng.integers(5))
    return tuple(changed)


def mutate_json(document: Any, rng: Generator) -> None:
    """Change one value somewhere in a tree of JSON."""
    places = _list_places(document)
    if not places:
        return
    owner, key = places[int(rng.integers(len(places)))]
    other, its = places[int(rng.integers(len(places)))]
    match int(rng.integers(7)):
        case 0:
            del owner[key]
        case 1:
            owner[key] = json.loads(json.dumps(other[its]))
        case 2 if isinstance(owner, list):
            owner.append(json.loads(json.dumps(owner[key])))
        case 2 | 3:
            owner[key] = VALUES[int(rng.integers(len(VALUES)))]
        case 4 if isinstance(owner[key], int):
            owner[key] += int(rng.integers(-2, 3))
        case 5:
            owner[key] = int(rng.integers(NODE_COUNT))
        case _:
            owner[key] = NUMBERS[int(rng.integers(len(NUMBERS)))]


def _list_places(document: Any) -> list[tuple[Any, Any]]:
    """List every value in a tree of JSON: what holds it, and its key or place there."""
    places: list[tuple[Any, Any]] = []
    waiting = [document] if isinstance(document, dict | list) else []
    while waiting:
        item = waiting.pop()
        keys = list(item) if isinstance(item, dict) else list(range(len(item)))
        places += [(item, key) for key in keys]
        waiting += [item[key] for key in keys if isinstance(item[key], dict | list)]
    return places

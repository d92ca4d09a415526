"""FBX files made in tests: records as bytes, and whole characters in any units and axes."""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bunraku.formats.fbx.records import ARRAYS, MAGIC, Packed
from bunraku.rotations import compose_transforms
from bunraku.skinning import forward_kinematics
from bunraku.types import NO_PARENT, Character, Clip

TICKS = 46186158000
KINDS = {np.dtype(name): letter for letter, name in ARRAYS.items() if letter not in "bc"}
LETTERS = "XYZ"


@dataclass
class Node:
    """A record to be written."""

    name: str
    values: tuple[Any, ...] = ()
    inside: list["Node"] = field(default_factory=list)

    def add(self, name: str, *values: Any) -> "Node":
        self.inside.append(Node(name, values))
        return self.inside[-1]


def encode(records: Sequence[Node], *, version: int = 7400, packed: bool = True) -> bytes:
    """Write records as a binary FBX file."""
    head = struct.Struct("<QQQB" if version >= 7500 else "<IIIB")
    content = bytearray(MAGIC + struct.pack("<I", version))

    def write(node: Node) -> None:
        start = len(content)
        name, values = node.name.encode(), b"".join(_value(v, packed) for v in node.values)
        content.extend(head.pack(0, 0, 0, 0) + name + values)
        for inner in node.inside:
            write(inner)
        if node.inside:
            content.extend(bytes(head.size))
        fields = len(content), len(node.values), len(values), len(name)
        content[start : start + head.size] = head.pack(*fields)

    for node in records:
        write(node)
    return bytes(content) + bytes(head.size) + b"\xfa" * 32


def _value(value: Any, packed: bool) -> bytes:
    match value:
        case bool():
            return struct.pack("<c?", b"C", value)
        case int():
            return struct.pack("<cq", b"L", max(-(2**63), min(value, 2**63 - 1)))
        case float():
            return struct.pack("<cd", b"D", value)
        case str():
            return b"S" + struct.pack("<I", len(value.encode())) + value.encode()
        case bytes():
            return b"R" + struct.pack("<I", len(value)) + value
        case Packed():
            fields = value.count, int(value.is_packed), len(value.content)
            return value.kind.encode() + struct.pack("<III", *fields) + bytes(value.content)
    plain = value.tobytes()
    content = zlib.compress(plain) if packed else plain
    head = struct.pack("<III", len(value), int(packed), len(content))
    return KINDS[value.dtype].encode() + head + content


def properties(node: Node, **values: Any) -> None:
    """Add a table of properties; `_` in a name stands for a space."""
    table = node.inside[0] if node.inside else node.add("Properties70")
    for name, value in values.items():
        numbers = value if isinstance(value, list | tuple) else [value]
        table.add("P", name.replace("_", " "), "", "", "A", *numbers)


def encode_character(
    character: Character,
    *,
    centimetres: float = 1.0,
    file_from_world: np.ndarray | None = None,
    axes: dict[str, int] | None = None,
    before: Sequence[float] = (10.0, 20.0, 30.0),
    pivot: Sequence[float] = (1.0, 2.0, 3.0),
    **how: Any,
) -> bytes:
    """Write a character as FBX: units, axes, a pre-rotation and a pivot of every joint as given."""
    if file_from_world is None:
        file_from_world = np.eye(3)
    maker = Maker(character, 100.0 / centimetres, file_from_world, tuple(before), tuple(pivot))
    settings = Node("GlobalSettings")
    properties(settings, UnitScaleFactor=float(centimetres), **(axes or {}))
    return encode([settings, *maker.make()], **how)


@dataclass
class Maker:
    """A character on its way into records."""

    character: Character
    units: float = 100.0  # a metre
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))  # file_from_world
    before: tuple[float, ...] = (0.0, 0.0, 0.0)
    pivot: tuple[float, ...] = (0.0, 0.0, 0.0)
    objects: Node = field(default_factory=lambda: Node("Objects"))
    links: Node = field(default_factory=lambda: Node("Connections"))

    def make(self) -> list[Node]:
        for joint in range(len(self.character.skeleton.names)):
            self.add_joint(joint)
        self.add_mesh()
        for number, clip in enumerate(self.character.clips):
            self.add_clip(10_000 * (number + 1), clip)
        return [self.objects, self.links]

    def add(self, kind: str, number: int, name: str, subkind: str) -> Node:
        return self.objects.add(kind, number, f"{name}\0\x01{kind}", subkind)

    def connect(self, child: int, parent: int, name: str = "") -> None:
        self.links.add("C", *(("OP", child, parent, name) if name else ("OO", child, parent)))

    def channels(self, joint: int, moved: np.ndarray, rotations: np.ndarray) -> tuple[Any, Any]:
        """Give Lcl Translation and Rotation that lead to a place below the parent."""
        moved, pivot = moved * self.units, np.asarray(self.pivot)
        if self.character.skeleton.parents[joint] == NO_PARENT:
            moved, rotations = moved @ self.turn.T, self.turn @ rotations
        moved = moved - pivot + np.einsum("fij,j->fi", rotations, pivot)
        before = Rotation.from_euler("xyz", self.before, degrees=True).as_matrix()
        return moved, Rotation.from_matrix(before.T @ rotations).as_euler("xyz", degrees=True)

    def add_joint(self, joint: int) -> None:
        skeleton = self.character.skeleton
        rest = skeleton.rest[joint][None]
        moved, angles = self.channels(joint, rest[:, :3, 3], rest[:, :3, :3])
        model = self.add("Model", 100 + joint, skeleton.names[joint], "LimbNode")
        local = {"Lcl_Translation": moved[0].tolist(), "Lcl_Rotation": angles[0].tolist()}
        own = {"PreRotation": list(self.before), "RotationPivot": list(self.pivot)}
        properties(model, **local, **own)
        parent = int(skeleton.parents[joint])
        self.connect(100 + joint, 100 + parent if parent != NO_PARENT else 0)

    def add_mesh(self) -> None:
        mesh = self.character.mesh
        self.add("Model", 1, "body", "Mesh").add("Properties70")
        geometry = self.add("Geometry", 2, "body", "Mesh")
        geometry.add("Vertices", (mesh.vertices @ self.turn.T * self.units).ravel())
        corners = mesh.faces.astype("<i4").copy()
        corners[:, 2] = -1 - corners[:, 2]
        geometry.add("PolygonVertexIndex", corners.ravel())
        layer = geometry.add("LayerElementUV", 0)
        layer.add("MappingInformationType", "ByPolygonVertex")
        layer.add("ReferenceInformationType", "IndexToDirect")
        layer.add("UV", np.array([0.25, 0.75]))
        layer.add("UVIndex", np.zeros(corners.size, "<i4"))
        layer = geometry.add("LayerElementNormal", 0)
        layer.add("MappingInformationType", "AllSame")
        layer.add("ReferenceInformationType", "Direct")
        layer.add("Normals", np.array([0.0, 0, 1]))
        properties(self.add("Material", 4, "red", ""), DiffuseColor=[1.0, 0.0, 0.0])
        self.add("Deformer", 3, "", "Skin")
        for child, parent in ((1, 0), (2, 1), (4, 1), (3, 2)):
            self.connect(child, parent)
        self.add_clusters()

    def add_clusters(self) -> None:
        skeleton, skin = self.character.skeleton, self.character.skin
        world = forward_kinematics(skeleton.parents, skeleton.rest)
        for joint in range(len(skeleton.names)):
            cluster = self.add("Deformer", 1000 + joint, "", "Cluster")
            moved = np.flatnonzero(skin.weights[:, joint])
            cluster.add("Indexes", moved.astype("<i4"))
            cluster.add("Weights", skin.weights[moved, joint])
            place = world[joint, :3, 3] @ self.turn.T * self.units
            placed = compose_transforms(place, self.turn @ world[joint, :3, :3])
            cluster.add("Transform", np.linalg.inv(placed).T.ravel())
            self.connect(1000 + joint, 3)
            self.connect(100 + joint, 1000 + joint)

    def add_clip(self, base: int, clip: Clip) -> None:
        self.add("AnimationStack", base, clip.name, "")
        self.add("AnimationLayer", base + 1, "layer", "")
        self.connect(base + 1, base)
        matrices = Rotation.from_quat(clip.rotations.reshape(-1, 4)).as_matrix()
        matrices = matrices.reshape(*clip.rotations.shape[:2], 3, 3)
        ticks = np.rint(clip.times * TICKS).astype("<i8")
        for joint in range(clip.rotations.shape[1]):
            moved, angles = self.channels(joint, clip.translations[:, joint], matrices[:, joint])
            rest = self.character.skeleton.rest[joint][None]
            still = *self.channels(joint, rest[:, :3, 3], rest[:, :3, :3]), np.ones((1, 3))
            tracks = {"Translation": moved, "Rotation": angles, "Scaling": clip.scales[:, joint]}
            for place, (name, values) in enumerate(tracks.items()):
                if np.abs(values - still[place]).max() < 1e-9:
                    continue
                group = base + 100 + 20 * joint + 5 * place
                self.add("AnimationCurveNode", group, name[0], "")
                self.connect(group, base + 1)
                self.connect(group, 100 + joint, f"Lcl {name}")
                for axis in range(3):
                    self.add_curve(group + 1 + axis, ticks, values[:, axis])
                    self.connect(group + 1 + axis, group, f"d|{LETTERS[axis]}")

    def add_curve(self, number: int, ticks: np.ndarray, values: np.ndarray) -> None:
        curve = self.add("AnimationCurve", number, "", "")
        curve.add("KeyTime", ticks)
        curve.add("KeyValueFloat", values.astype("<f4"))
        curve.add("KeyAttrFlags", np.array([4], "<i4"))
        curve.add("KeyAttrDataFloat", np.zeros(4, "<f4"))
        curve.add("KeyAttrRefCount", np.array([len(ticks)], "<i4"))

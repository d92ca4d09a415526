"""Build small glTF documents by hand, one part at a time, right or wrong."""

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


@dataclass
class Made:
    """A document and the bytes of its buffer."""

    json: dict[str, Any] = field(default_factory=lambda: {"asset": {"version": "2.0"}})
    binary: bytearray = field(default_factory=bytearray)

    def add(self, section: str, **item: Any) -> int:
        self.json.setdefault(section, []).append(item)
        return len(self.json[section]) - 1

    def view(self, content: bytes, **more: Any) -> int:
        self.binary.extend(bytes(-len(self.binary) % 4))
        offset = len(self.binary)
        self.binary.extend(content)
        return self.add("bufferViews", buffer=0, byteOffset=offset, byteLength=len(content), **more)

    def array(self, values: Any, kind: str, *, store: str = "f4", **more: Any) -> int:
        values = np.asarray(values, f"<{store}")
        return self.add(
            "accessors",
            bufferView=self.view(values.tobytes()),
            componentType=CODES[store],
            count=len(values),
            type=kind,
            **more,
        )

    def primitive(self, vertices: Any, faces: Any = None, **attributes: int) -> dict[str, Any]:
        position = self.array(
            vertices,
            "VEC3",
            min=np.min(vertices, axis=0).tolist(),
            max=np.max(vertices, axis=0).tolist(),
        )
        item: dict[str, Any] = {"attributes": {"POSITION": position, **attributes}}
        if faces is not None:
            item["indices"] = self.array(np.ravel(faces), "SCALAR", store="u2")
        return item

    def weights(self, joints: Any, weights: Any) -> dict[str, int]:
        return {
            "JOINTS_0": self.array(joints, "VEC4", store="u1"),
            "WEIGHTS_0": self.array(weights, "VEC4"),
        }

    def skin(self, joints: list[int], inverse_bind: Any) -> int:
        columns = np.asarray(inverse_bind, float).transpose(0, 2, 1).reshape(-1, 16)
        return self.add("skins", joints=joints, inverseBindMatrices=self.array(columns, "MAT4"))

    def clip(self, name: str, *tracks: tuple[int, str, Any, Any, str]) -> int:
        """Each track: node, path, times, values, interpolation."""
        channels, samplers = [], []
        for node, path, times, values, interpolation in tracks:
            keys = self.array(
                times, "SCALAR", min=[float(np.min(times))], max=[float(np.max(times))]
            )
            output = self.array(values, "VEC4" if path == "rotation" else "VEC3")
            target = {"node": node, "path": path}
            channels.append({"sampler": len(samplers), "target": target})
            samplers.append({"input": keys, "output": output, "interpolation": interpolation})
        return self.add("animations", name=name, channels=channels, samplers=samplers)

    def glb(self) -> bytes:
        if self.binary:
            self.json.setdefault("buffers", [{}])[0]["byteLength"] = len(self.binary)
        text = json.dumps(self.json).encode()
        return pack_glb(text, bytes(self.binary) if self.binary else None)


def pack_glb(text: bytes, binary: bytes | None = None) -> bytes:
    """Wrap JSON and bytes in a GLB container."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary is not None:
        binary += b"\0" * (-len(binary) % 4)
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def made_triangle() -> Made:
    """One triangle that one node shows."""
    made = Made()
    made.add("meshes", primitives=[made.primitive(TRIANGLE, [[0, 1, 2]])])
    made.add("nodes", mesh=0)
    made.add("scenes", nodes=[0])
    made.json["scene"] = 0
    return made


def made_arm(clip: bool = True) -> Made:
    """A strip of four vertices on two joints, bound one metre apart along +X; the elbow bends."""
    made = Made()
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0]], np.float32)
    weights = made.weights(
        [[0, 0, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]],
        [[1, 0, 0, 0], [0.5, 0.5, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]],
    )
    primitive = made.primitive(vertices, [[0, 1, 2], [1, 3, 2]], **weights)
    made.add("meshes", primitives=[primitive])
    made.add("nodes", name="arm", mesh=0, skin=0)
    made.add("nodes", name="shoulder", children=[2])
    made.add("nodes", name="elbow", translation=[1, 0, 0])
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[1, 0, 3] = -1
    made.skin([1, 2], bind)
    made.add("scenes", nodes=[0, 1])
    made.json["scene"] = 0
    if clip:
        half = np.sqrt(0.5)
        turn = [[0, 0, 0, 1], [0, 0, half, half]]
        made.clip("bend", (2, "rotation", [0, 1], turn, "LINEAR"))
    return made

"""The parts of a glTF 2.0 document that bunraku reads, typed; what it does not read passes by.

Reference:
    Khronos Group 2021, "glTF 2.0 Specification", sections 3 and 5.
"""

from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta, Struct, field

Index = Annotated[int, Meta(ge=0)]
Count = Annotated[int, Meta(ge=1)]
Vector = Annotated[list[float], Meta(min_length=3, max_length=3)]
Quaternion = Annotated[list[float], Meta(min_length=4, max_length=4)]
Matrix = Annotated[list[float], Meta(min_length=16, max_length=16)]
COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
ElementType = Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"]


class Asset(Struct):
    """Which glTF this is."""

    version: str | int | float  # a number breaks the specification, but leaves nothing open


class Buffer(Struct, rename="camel"):
    """A run of bytes: the binary chunk, a data URI or a file beside the document."""

    byte_length: Count
    uri: str | None = None


class BufferView(Struct, rename="camel"):
    """A slice of a buffer."""

    buffer: Index
    byte_length: Count
    byte_offset: Index = 0
    byte_stride: Annotated[int, Meta(ge=4, le=252, multiple_of=4)] | None = None


class SparseIndices(Struct, rename="camel"):
    """Where the elements that differ are."""

    buffer_view: Index
    component_type: Literal[5121, 5123, 5125]
    byte_offset: Index = 0


class SparseValues(Struct, rename="camel"):
    """What the elements that differ are."""

    buffer_view: Index
    byte_offset: Index = 0


class Sparse(Struct):
    """Elements that differ from the accessor's own."""

    count: Count
    indices: SparseIndices
    values: SparseValues


class Accessor(Struct, rename="camel"):
    """An array of numbers in a buffer view."""

    component_type: Literal[5120, 5121, 5122, 5123, 5125, 5126]
    count: Count
    type: ElementType
    buffer_view: Index | None = None
    byte_offset: Index = 0
    normalized: bool = False
    sparse: Sparse | None = None

    @property
    def is_placeholder(self) -> bool:
        """Tell that no element has data of its own: glTF takes zeros for them."""
        return self.buffer_view is None and self.sparse is None


class Draco(Struct, rename="camel"):
    """Where the compressed arrays of a primitive are, and the decoder's number of each."""

    buffer_view: Index
    attributes: dict[str, Index]


class PrimitiveExtensions(Struct, frozen=True):
    """The extensions of a primitive that are read."""

    draco: Draco | None = field(default=None, name="KHR_draco_mesh_compression")


class Primitive(Struct):
    """Geometry of one material."""

    attributes: dict[str, Index]
    indices: Index | None = None
    mode: Annotated[int, Meta(ge=0, le=6)] = 4
    material: Index | None = None
    targets: list[dict[str, Index]] = []
    extensions: PrimitiveExtensions = PrimitiveExtensions()


class Mesh(Struct):
    """Primitives that are shown together."""

    primitives: Annotated[list[Primitive], Meta(min_length=1)]
    name: str | None = None


class Node(Struct):
    """A frame in the scene, with what hangs on it."""

    children: list[Index] = []
    mesh: Index | None = None
    skin: Index | None = None
    matrix: Matrix | None = None
    translation: Vector | None = None
    rotation: Quaternion | None = None
    scale: Vector | None = None
    weights: list[float] | None = None  # of the mesh's morph targets
    name: str | None = None


class Skin(Struct, rename="camel"):
    """Joints, and where each was when the mesh was bound."""

    joints: Annotated[list[Index], Meta(min_length=1)]
    inverse_bind_matrices: Index | None = None
    skeleton: Index | None = None
    name: str | None = None


class Scene(Struct):
    """The roots of what is shown."""

    nodes: list[Index] = []


class ChannelTarget(Struct):
    """What a channel moves."""

    path: str
    node: Index | None = None


class Channel(Struct):
    """A sampler applied to a target."""

    sampler: Index
    target: ChannelTarget


class Sampler(Struct):
    """Key times, and a value for each."""

    input: Index
    output: Index
    interpolation: Literal["LINEAR", "STEP", "CUBICSPLINE"] = "LINEAR"


class Animation(Struct):
    """A clip."""

    channels: list[Channel] = []
    samplers: list[Sampler] = []
    name: str | None = None


class Image(Struct, rename="camel"):
    """A picture: a buffer view, a data URI or a file beside the document."""

    uri: str | None = None
    buffer_view: Index | None = None
    mime_type: str | None = None


class Material(Struct):
    """Only its name is read."""

    name: str | None = None


class Gltf(Struct, rename="camel"):
    """The whole document."""

    asset: Asset
    accessors: list[Accessor] = []
    animations: list[Animation] = []
    buffers: list[Buffer] = []
    buffer_views: list[BufferView] = []
    images: list[Image] = []
    materials: list[Material] = []
    meshes: list[Mesh] = []
    nodes: list[Node] = []
    scenes: list[Scene] = []
    scene: Index | None = None
    skins: list[Skin] = []
    extensions_used: list[str] = []
    extensions_required: list[str] = []

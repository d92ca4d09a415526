"""Check a document's cross references and byte ranges in plain integers, before any allocation."""

from collections.abc import Iterator

from bunraku import limits
from bunraku.errors import Code, announce
from bunraku.formats.gltf.schema import COMPONENTS, WIDTHS, Accessor, Gltf
from bunraku.types import FormatError

Reference = tuple[str, int | None, int, str]


def check_references(path: str, gltf: Gltf) -> None:
    """Raise a FormatError if any index points at nothing, or there are too many nodes or joints."""
    if len(gltf.nodes) > limits.NODES:
        message = f"{len(gltf.nodes)} nodes, at most {limits.NODES} are read; flatten the scene"
        raise FormatError(path, "/nodes", message, code=Code.LIMIT_NODES)
    for where, index, count, what in _references(gltf):
        if index is not None and index >= count:
            message = f"{what} {index} does not exist (there are {count})"
            raise FormatError(path, where, message, code=Code.GLTF_INDEX)
    for s, skin in enumerate(gltf.skins):
        if len(skin.joints) > limits.JOINTS:
            message = f"{len(skin.joints)} joints, at most {limits.JOINTS} are read; split the skin"
            raise FormatError(path, f"/skins/{s}/joints", message, code=Code.LIMIT_JOINTS)
        again = len(skin.joints) - len(set(skin.joints))
        if again:
            message = f"{again} joints are there more than once; their weights are added up"
            announce(path, message, code=Code.SKIN_JOINTS, where=f"/skins/{s}/joints")


def check_ranges(path: str, gltf: Gltf) -> None:
    """Check, in plain integers, that every buffer view and accessor lies inside its bytes."""
    for v, view in enumerate(gltf.buffer_views):
        end, size = view.byte_offset + view.byte_length, gltf.buffers[view.buffer].byte_length
        if end > size:
            message = f"ends at byte {end} of a buffer of {size}"
            raise FormatError(path, f"/bufferViews/{v}", message, code=Code.GLTF_RANGE)
    for index in range(len(gltf.accessors)):
        _check_fit(path, gltf, index)


def _check_fit(path: str, gltf: Gltf, index: int) -> None:
    accessor, where = gltf.accessors[index], f"/accessors/{index}"
    if accessor.buffer_view is None:
        if accessor.count > limits.VERTICES:
            raise FormatError(
                path,
                f"{where}/count",
                f"{accessor.count} elements without any data",
                code=Code.LIMIT_VERTICES,
            )
    else:
        size = _element_size(accessor)
        stride = gltf.buffer_views[accessor.buffer_view].byte_stride or size
        if stride < size:
            message = f"elements of {size} bytes, {stride} bytes apart"
            raise FormatError(
                path,
                f"/bufferViews/{accessor.buffer_view}/byteStride",
                message,
                code=Code.GLTF_RANGE,
            )
        end = accessor.byte_offset + stride * (accessor.count - 1) + size
        _check_end(path, gltf, (where, accessor.buffer_view, end))
    if accessor.sparse is not None:
        for name, view, end in _sparse_ends(path, index, accessor):
            _check_end(path, gltf, (f"{where}/sparse/{name}", view, end))


def _sparse_ends(path: str, index: int, accessor: Accessor) -> list[tuple[str, int, int]]:
    """Give the view, and the end of what is needed of it, of a sparse accessor's two arrays."""
    sparse = accessor.sparse
    assert sparse is not None
    if sparse.count > accessor.count:
        message = f"{sparse.count} elements differ, of {accessor.count}"
        raise FormatError(path, f"/accessors/{index}/sparse/count", message, code=Code.GLTF_RANGE)
    indices, values = sparse.indices, sparse.values
    places = indices.byte_offset + sparse.count * COMPONENTS[indices.component_type].itemsize
    end = values.byte_offset + sparse.count * _element_size(accessor)
    return [("indices", indices.buffer_view, places), ("values", values.buffer_view, end)]


def _check_end(path: str, gltf: Gltf, need: tuple[str, int, int]) -> None:
    where, view, end = need
    size = gltf.buffer_views[view].byte_length
    if end > size:
        raise FormatError(
            path,
            where,
            f"needs {end} bytes of buffer view {view}, which has {size}",
            code=Code.GLTF_RANGE,
        )


def _element_size(accessor: Accessor) -> int:
    """Give the bytes of an element; the columns of matrices start at multiples of four."""
    item = COMPONENTS[accessor.component_type].itemsize
    if accessor.type.startswith("MAT"):
        rows = int(accessor.type[3])
        return rows * (-(-rows * item // 4) * 4)
    return WIDTHS[accessor.type] * item


def _references(gltf: Gltf) -> Iterator[Reference]:
    """List every index in the document: where it is, itself, how many there are, of what."""
    yield from _scene_references(gltf)
    yield from _skin_references(gltf)
    yield from _accessor_references(gltf)
    yield from _mesh_references(gltf)
    yield from _animation_references(gltf)


def _scene_references(gltf: Gltf) -> Iterator[Reference]:
    nodes = len(gltf.nodes)
    if gltf.scene is not None:
        yield "/scene", gltf.scene, len(gltf.scenes), "scene"
    for s, scene in enumerate(gltf.scenes):
        for i, node in enumerate(scene.nodes):
            yield f"/scenes/{s}/nodes/{i}", node, nodes, "node"
    for n, item in enumerate(gltf.nodes):
        for i, node in enumerate(item.children):
            yield f"/nodes/{n}/children/{i}", node, nodes, "node"
        yield f"/nodes/{n}/mesh", item.mesh, len(gltf.meshes), "mesh"
        yield f"/nodes/{n}/skin", item.skin, len(gltf.skins), "skin"


def _skin_references(gltf: Gltf) -> Iterator[Reference]:
    for s, skin in enumerate(gltf.skins):
        where = f"/skins/{s}"
        for i, node in enumerate(skin.joints):
            yield f"{where}/joints/{i}", node, len(gltf.nodes), "node"
        matrices = skin.inverse_bind_matrices
        yield f"{where}/inverseBindMatrices", matrices, len(gltf.accessors), "accessor"
        yield f"{where}/skeleton", skin.skeleton, len(gltf.nodes), "node"


def _accessor_references(gltf: Gltf) -> Iterator[Reference]:
    views = len(gltf.buffer_views)
    for v, view in enumerate(gltf.buffer_views):
        yield f"/bufferViews/{v}/buffer", view.buffer, len(gltf.buffers), "buffer"
    for a, accessor in enumerate(gltf.accessors):
        where, sparse = f"/accessors/{a}", accessor.sparse
        yield f"{where}/bufferView", accessor.buffer_view, views, "bufferView"
        if sparse is not None:
            yield f"{where}/sparse/indices/bufferView", sparse.indices.buffer_view, views, "view"
            yield f"{where}/sparse/values/bufferView", sparse.values.buffer_view, views, "view"
    for i, image in enumerate(gltf.images):
        yield f"/images/{i}/bufferView", image.buffer_view, views, "bufferView"


def _mesh_references(gltf: Gltf) -> Iterator[Reference]:
    accessors = len(gltf.accessors)
    for m, mesh in enumerate(gltf.meshes):
        for p, primitive in enumerate(mesh.primitives):
            where = f"/meshes/{m}/primitives/{p}"
            for name, index in primitive.attributes.items():
                yield f"{where}/attributes/{name}", index, accessors, "accessor"
            for i, target in enumerate(primitive.targets):
                for name, index in target.items():
                    yield f"{where}/targets/{i}/{name}", index, accessors, "accessor"
            yield f"{where}/indices", primitive.indices, accessors, "accessor"
            yield f"{where}/material", primitive.material, len(gltf.materials), "material"
            draco = primitive.extensions.draco
            if draco is not None:
                yield f"{where}/extensions", draco.buffer_view, len(gltf.buffer_views), "view"


def _animation_references(gltf: Gltf) -> Iterator[Reference]:
    accessors, nodes = len(gltf.accessors), len(gltf.nodes)
    for a, animation in enumerate(gltf.animations):
        for c, channel in enumerate(animation.channels):
            where = f"/animations/{a}/channels/{c}"
            yield f"{where}/sampler", channel.sampler, len(animation.samplers), "sampler"
            yield f"{where}/target/node", channel.target.node, nodes, "node"
        for s, sampler in enumerate(animation.samplers):
            where = f"/animations/{a}/samplers/{s}"
            yield f"{where}/input", sampler.input, accessors, "accessor"
            yield f"{where}/output", sampler.output, accessors, "accessor"

"""Surfaces and skins of an FBX file."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from bunraku import limits
from bunraku.errors import NOTE, Code, announce
from bunraku.formats.fbx.records import Packed, Record, damaged, unpack
from bunraku.formats.fbx.scene import Scene, Thing
from bunraku.formats.obj import ABSENT, unite_corners
from bunraku.formats.polygons import triangulate
from bunraku.types import FormatError

INFLUENCES = 8  # of a vertex: the heaviest ones
MOST_BONES = 1_000_000  # of all meshes together
Corners = Int[np.ndarray, " corners"]


@dataclass(frozen=True, eq=False)
class Surface:
    """A geometry as triangles; vertices are doubled along seams and borders of materials."""

    points: Float[np.ndarray, "points 3"]  # those in use, in the file's own space and units
    used: Int[np.ndarray, " points"]  # their numbers in the file
    given: int  # how many points the file has
    point_of: Int[np.ndarray, " vertices"]
    part_of: Int[np.ndarray, " vertices"]  # place of the material in the node's list
    faces: Int[np.ndarray, "faces 3"]
    uvs: Float[np.ndarray, "vertices 2"] | None = None
    normals: Float[np.ndarray, "vertices 3"] | None = None


@dataclass(frozen=True, eq=False)
class Binding:
    """Which bones move a geometry, and how much."""

    bones: list[int] = field(default_factory=list)  # numbers of their nodes
    bone_from_node: list[Float[np.ndarray, "4 4"]] = field(default_factory=list)  # file units
    joints: Int[np.ndarray, "points influences"] = field(
        default_factory=lambda: np.zeros((0, INFLUENCES), np.int64)
    )
    weights: Float[np.ndarray, "points influences"] = field(
        default_factory=lambda: np.zeros((0, INFLUENCES))
    )


def read_surface(scene: Scene, geometry: Thing) -> Surface | None:
    """Read a geometry; nothing if it has no polygons.

    Raises:
        FormatError: if it is damaged, or holds more vertices than are read.
    """
    record, path = geometry.record, scene.path
    points = _numbers(scene, geometry, record.first("Vertices"))
    corners = _numbers(scene, geometry, record.first("PolygonVertexIndex")).astype(np.int64)
    if not len(points) or not len(corners):
        return None
    if len(points) % 3:
        raise damaged(path, geometry.where, f"{len(points)} numbers are no whole vertices")
    points = points.reshape(-1, 3).astype(np.float64)
    wrong = ~(np.abs(points) < limits.COORDINATE).all(axis=1)
    if wrong.any():
        message = f"vertex {int(wrong.argmax())} is not finite or too large; repair the mesh"
        raise FormatError(path, geometry.where, message, code=Code.MESH_NONFINITE)
    if max(len(points), len(corners) // 3) > limits.VERTICES:
        message = f"has more than {limits.VERTICES} vertices; decimate it"
        raise FormatError(path, geometry.where, message, code=Code.LIMIT_VERTICES)
    corners, starts = _split(scene, geometry, corners, len(points))
    faces, polygon_of = _triangulate(scene, geometry, points, corners=corners, starts=starts)
    if not len(faces):
        return None
    part_of = _materials(scene, geometry, len(starts) - 1)[polygon_of]
    table = np.full((len(corners), 3), ABSENT)
    table[:, 0] = corners
    layers: dict[str, np.ndarray] = {}
    for column, (name, inner, width) in enumerate(
        (("LayerElementUV", "UV", 2), ("LayerElementNormal", "Normals", 3)), start=1
    ):
        layer = _layer(scene, geometry, name, inner, width, corners=corners)
        if layer is not None:
            layers[inner], table[:, column] = layer
    order = np.argsort(part_of, kind="stable")
    rows, faces = unite_corners(np.repeat(part_of[order], 3), table[faces[order].reshape(-1)])
    used, point_of = np.unique(rows[:, 1], return_inverse=True)
    return Surface(
        points[used],
        used,
        len(points),
        point_of,
        rows[:, 0],
        faces,
        layers["UV"][rows[:, 2]] if "UV" in layers else None,
        layers["Normals"][rows[:, 3]] if "Normals" in layers else None,
    )


def _numbers(scene: Scene, thing: Thing, record: Record | None) -> np.ndarray:
    """Unpack the array of a record; an empty one where there is none."""
    if record is None or not record.values:
        return np.zeros(0)
    return unpack(scene.path, f"{thing.where} {record.name}", record.values[0])


def _split(
    scene: Scene, geometry: Thing, corners: Corners, count: int
) -> tuple[Corners, Int[np.ndarray, " starts"]]:
    """Split corners into polygons, whose last ones are written as -1 - index."""
    last = corners < 0
    corners = np.where(last, -1 - corners, corners)
    if not last[-1]:
        raise damaged(scene.path, geometry.where, "the last polygon has no end")
    if corners.max() >= count:
        place = int((corners >= count).argmax())
        message = f"corner {place} is vertex {corners[place]} of {count}; export the mesh again"
        raise FormatError(scene.path, geometry.where, message, code=Code.MESH_INDEX)
    return corners, np.concatenate([[0], np.flatnonzero(last) + 1])


def _triangulate(
    scene: Scene,
    geometry: Thing,
    points: Float[np.ndarray, "points 3"],
    *,
    corners: Corners,
    starts: Int[np.ndarray, " starts"],
) -> tuple[Int[np.ndarray, "faces 3"], Int[np.ndarray, " faces"]]:
    """Cut polygons into triangles (places of corners); loose edges are left out aloud.

    Returns:
        triangles as places in `corners`, and the polygon that each one comes from.
    """
    counts = np.diff(starts)
    kept = counts >= 3
    if kept.all():
        return triangulate(points, corners, starts)
    message = f"{int((~kept).sum())} polygons have fewer than three corners; they are left out"
    announce(scene.path, message, code=Code.MESH_CORNERS, where=geometry.where)
    places = np.flatnonzero(np.repeat(kept, counts))
    borders = np.concatenate([[0], np.cumsum(counts[kept])])
    faces, polygon_of = triangulate(points, corners[places], borders)
    return places[faces], np.flatnonzero(kept)[polygon_of]


def _materials(scene: Scene, geometry: Thing, polygons: int) -> Int[np.ndarray, " polygons"]:
    """Give the place of each polygon's material in its node's list."""
    layer = geometry.record.first("LayerElementMaterial")
    found = np.zeros(polygons, np.int64)
    if layer is not None:
        given = _numbers(scene, geometry, layer.first("Materials")).astype(np.int64)
        if layer.text("MappingInformationType") == "ByPolygon" and len(given) == polygons:
            found = np.maximum(given, 0)
        elif len(given) == 1:
            found[:] = max(int(given[0]), 0)
    return np.minimum(found, scene.material_count)  # beyond: none


def _layer(
    scene: Scene, geometry: Thing, name: str, inner: str, width: int, *, corners: Corners
) -> tuple[Float[np.ndarray, "rows width"], Corners] | None:
    """Read what each corner has of a layer: its rows, and the row of each corner.

    Nothing if there is no such layer; what does not fit together is left out aloud.
    """
    layer = geometry.record.first(name)
    if layer is None:
        return None
    rows = _numbers(scene, geometry, layer.first(inner)).astype(np.float64)
    mapping = layer.text("MappingInformationType")
    index = {"ByPolygonVertex": np.arange(len(corners)), "AllSame": np.zeros_like(corners)}
    index |= dict.fromkeys(("ByVertice", "ByVertex"), corners)
    chosen = index.get(mapping)
    if chosen is not None and layer.text("ReferenceInformationType") in ("IndexToDirect", "Index"):
        given = _numbers(scene, geometry, layer.first(f"{inner}Index")).astype(np.int64)
        fits = len(given) > 0 and chosen.max() < len(given)
        chosen = given[chosen] if fits else None
    count = len(rows) // width
    if chosen is None or not count or chosen.min() < 0 or chosen.max() >= count:
        message = f"{name} does not fit the polygons; it is left out"
        announce(scene.path, message, code=Code.MESH_LEFT_OUT, where=geometry.where, level=NOTE)
        return None
    rows = rows[: count * width].reshape(-1, width)
    return np.where(np.abs(rows) < limits.COORDINATE, rows, 0.0), chosen


def check_bindings(scene: Scene) -> None:
    """Refuse more weights or bones than are read, of all geometries together, before unpacking.

    Raises:
        FormatError: if there are more; a cluster counts for every geometry that it moves.
    """
    weights = bones = 0
    for geometry in scene.of("Geometry", "Mesh"):
        clusters = _clusters(scene, geometry)
        bones += len(clusters)
        weights += sum(_claim(cluster) for cluster, _ in clusters)
        if weights > limits.WEIGHTS or bones > MOST_BONES:
            message = f"more than {limits.WEIGHTS} weights, or {MOST_BONES} bones of meshes"
            message += "; bind to fewer bones"
            raise FormatError(scene.path, geometry.where, message, code=Code.LIMIT_TOTAL)


def _clusters(scene: Scene, geometry: Thing) -> list[tuple[Thing, Thing]]:
    """Give the clusters of a geometry, each once, and the bone of each."""
    found = {
        cluster.number: (cluster, bone)
        for skin in scene.children(geometry, "Deformer", "Skin")
        for cluster in scene.children(skin, "Deformer", "Cluster")
        for bone in list(scene.children(cluster, "Model"))[:1]
    }
    return list(found.values())


def _claim(cluster: Thing) -> int:
    """Give how many weights a cluster says that it has."""
    arrays = (cluster.record.first(name) for name in ("Indexes", "Weights"))
    values = [array.values[0] for array in arrays if array and array.values]
    return max((value.count for value in values if isinstance(value, Packed)), default=0)


def read_binding(scene: Scene, geometry: Thing, surface: Surface) -> Binding | None:
    """Read the skin of a geometry for the points in use; nothing if it has none.

    Raises:
        FormatError: if a matrix or list of weights is damaged.
    """
    clusters = _clusters(scene, geometry)
    if not clusters:
        return None
    place_of = np.full(surface.given, -1)
    place_of[surface.used] = np.arange(len(surface.used))
    bones, matrices, entries = [], [], []
    for number, (cluster, bone) in enumerate(clusters):
        bones.append(bone.number)
        matrices.append(_read_bind(scene, cluster))
        indices = _numbers(scene, cluster, cluster.record.first("Indexes")).astype(np.int64)
        shares = _numbers(scene, cluster, cluster.record.first("Weights")).astype(np.float64)
        fits = len(indices) == len(shares)
        if not fits or not ((indices >= 0) & (indices < surface.given)).all():
            message = f"{len(shares)} weights do not fit {surface.given} vertices"
            message += "; bind the mesh again"
            raise FormatError(scene.path, cluster.where, message, code=Code.SKIN_WEIGHTS)
        kept = place_of[indices] >= 0
        places = place_of[indices[kept]]
        entries.append((places, np.full(len(places), number), shares[kept]))
    columns = map(np.concatenate, zip(*entries, strict=True))
    return Binding(bones, matrices, *_heaviest(*columns, points=len(surface.used)))


def _read_bind(scene: Scene, cluster: Thing) -> Float[np.ndarray, "4 4"]:
    """Read where a bone is from the node of the mesh, when it was bound."""
    record = cluster.record.first("Transform")
    value = record.values[0] if record and record.values else None
    is_long = isinstance(value, Packed) and value.count != 16
    matrix = np.zeros(0) if is_long else _numbers(scene, cluster, record)
    if len(matrix) != 16 or not (np.abs(matrix) < limits.COORDINATE).all():
        message = "has no Transform of 16 finite numbers; bind the mesh again"
        raise FormatError(scene.path, cluster.where, message, code=Code.SKIN_BIND)
    return matrix.reshape(4, 4).T


def _heaviest(
    indices: Corners, joints: Corners, shares: Float[np.ndarray, " corners"], *, points: int
) -> tuple[Int[np.ndarray, "points influences"], Float[np.ndarray, "points influences"]]:
    """Put the heaviest weights of each point side by side."""
    table = np.zeros((points, INFLUENCES), np.int64), np.zeros((points, INFLUENCES))
    order = np.lexsort((-np.nan_to_num(shares), indices))
    indices, joints, shares = indices[order], joints[order], shares[order]
    first = np.searchsorted(indices, indices)
    rank = np.arange(len(indices)) - first
    kept = rank < INFLUENCES
    table[0][indices[kept], rank[kept]] = joints[kept]
    table[1][indices[kept], rank[kept]] = shares[kept]
    return table

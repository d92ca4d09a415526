"""Triangle meshes as arrays: areas, normals, welding, parts, closest points, sampling."""

import math

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_matrix, csr_array
from scipy.sparse.csgraph import connected_components


def face_normals(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "faces 3"]:
    """Give each face's normal, as long as twice its area."""
    first, second, third = (vertices[corner] for corner in faces.T)
    second -= first
    third -= first
    normals = np.empty_like(first)
    for axis in range(3):  # np.cross takes five times as long on a million faces
        j, k = (axis + 1) % 3, (axis + 2) % 3
        normals[:, axis] = second[:, j] * third[:, k] - second[:, k] * third[:, j]
    return normals


def surface_area(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> float:
    """Sum the areas of all faces."""
    return float(igl.doublearea(vertices, faces).sum() / 2) if len(faces) else 0.0


def signed_volume(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> float:
    """Give the enclosed volume; negative if the faces are turned inside out."""
    first, second, third = vertices[faces].transpose(1, 0, 2)
    return float(np.einsum("fc,fc->", first, np.cross(second, third)) / 6)


def sum_at_vertices(
    values: Float[np.ndarray, "faces *values"], faces: Int[np.ndarray, "faces 3"], count: int
) -> Float[np.ndarray, "vertices *values"]:
    """Add each face's value to its three vertices."""
    columns = values.reshape(len(faces), math.prod(values.shape[1:]))
    sums = [
        sum(np.bincount(faces[:, corner], column, count) for corner in range(3))
        for column in columns.T
    ]
    return np.stack(sums, axis=1, dtype=np.float64).reshape(count, *values.shape[1:])


def sum_rows(
    place: Int[np.ndarray, " rows"], values: Float[np.ndarray, "rows *values"], count: int
) -> Float[np.ndarray, "count *values"]:
    """Add up the rows that go to the same place."""
    starts = np.arange(len(place) + 1)
    ones = csr_array((np.ones(len(place)), place, starts), shape=(len(place), count))
    summed: np.ndarray = ones.T @ values.reshape(len(values), math.prod(values.shape[1:]))
    return summed.reshape(count, *values.shape[1:])


def vertex_normals(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """Average the normals of the faces around each vertex, by area; zero where there are none."""
    normals = sum_at_vertices(face_normals(vertices, faces), faces, len(vertices))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def vertex_areas(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Float[np.ndarray, " vertices"]:
    """Give each vertex a third of the area of its faces."""
    areas = igl.doublearea(vertices, faces) / 2 if len(faces) else np.zeros(0)
    return sum_at_vertices(areas, faces, len(vertices)) / 3


def weld(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    *,
    tolerance: float = 1e-6,
) -> tuple[Float[np.ndarray, "welded 3"], Int[np.ndarray, "kept 3"], Int[np.ndarray, " vertices"]]:
    """Merge vertices at equal positions, and drop the faces that collapse.

    Args:
        tolerance: grid on which positions count as equal, as a share of the longest extent;
            5e-7 or more.

    Returns:
        the welded vertices, the faces that remain, and the welded vertex of each old vertex.
    """
    extent = float(np.ptp(vertices, axis=0).max()) if len(vertices) else 1.0
    grid = np.round((vertices - vertices.min(axis=0)) / max(tolerance * extent, 1e-300))
    places = grid.astype(np.int64)
    place = np.ravel_multi_index(tuple(places.T), tuple(places.max(axis=0) + 1))
    _, first, welded_of = np.unique(place, return_index=True, return_inverse=True)
    merged = welded_of[faces]
    first_corner, second_corner, third_corner = merged.T
    alive = (
        (first_corner != second_corner)
        & (second_corner != third_corner)
        & (third_corner != first_corner)
    )
    return vertices[first], merged[alive], welded_of


def connected_parts(faces: Int[np.ndarray, "faces 3"], count: int) -> Int[np.ndarray, " vertices"]:
    """Number the connected parts of a mesh of `count` vertices; give each vertex its part."""
    rows, columns = faces[:, :2].ravel(), faces[:, 1:].ravel()  # two edges tie three corners
    adjacency = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    return connected_components(adjacency, directed=False)[1].astype(np.int64)


def is_closed(faces: Int[np.ndarray, "faces 3"]) -> bool:
    """Tell whether every edge has exactly two faces that agree on its direction."""
    if not len(faces):
        return False
    starts, ends, count = faces.ravel(), faces[:, [1, 2, 0]].ravel(), int(faces.max()) + 1
    forward, backward = np.sort(starts * count + ends), np.sort(ends * count + starts)
    return bool((np.diff(forward) > 0).all()) and np.array_equal(forward, backward)


def closest_points(
    points: Float[np.ndarray, "points 3"],
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
) -> tuple[Int[np.ndarray, " points"], Float[np.ndarray, "points 3"], Float[np.ndarray, " points"]]:
    """Find the nearest point of a surface to each point.

    Returns:
        its face, its barycentric coordinates in that face, and its distance in metres.
    """
    squared, face, nearest = igl.point_mesh_squared_distance(
        np.ascontiguousarray(points), np.ascontiguousarray(vertices), np.ascontiguousarray(faces)
    )
    face = face.reshape(-1).astype(np.int64)
    first, second, third = (np.ascontiguousarray(vertices[faces[face, i]]) for i in range(3))
    barycentric = igl.barycentric_coordinates(np.ascontiguousarray(nearest), first, second, third)
    barycentric = np.clip(np.nan_to_num(barycentric, nan=1 / 3), 0.0, 1.0)
    barycentric /= barycentric.sum(axis=1, keepdims=True)
    return face, barycentric, np.sqrt(np.maximum(squared.reshape(-1), 0.0))


def interpolate(
    values: Float[np.ndarray, "vertices *values"],
    corners: Int[np.ndarray, "points 3"],
    barycentric: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, "points *values"]:
    """Blend the values of three vertices into each point.

    Args:
        values: one row a vertex.
        corners: the three vertices of the face that each point lies in, `faces[face]`.
        barycentric: their shares.
    """
    return np.einsum("pc,pc...->p...", barycentric, values[corners])


def farthest_points(
    points: Float[np.ndarray, "points dimensions"], count: int, *, start: int | None = None
) -> Int[np.ndarray, " chosen"]:
    """Choose points one by one, each the farthest from those chosen (from the mean, the first).

    Any prefix of the answer is itself such a sample, so coarse steps may use its beginning.
    """
    first = int(((points - points.mean(axis=0)) ** 2).sum(axis=1).argmax())
    chosen = np.empty(min(count, len(points)), np.int64)
    distance = np.full(len(points), np.inf)
    latest = first if start is None else start
    for i in range(len(chosen)):
        chosen[i] = latest
        np.minimum(distance, ((points - points[latest]) ** 2).sum(axis=1), out=distance)
        latest = int(distance.argmax())
    return chosen


def sample_surface(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    count: int,
    rng: np.random.Generator,
) -> tuple[Int[np.ndarray, " count"], Float[np.ndarray, "count 3"]]:
    """Draw points evenly from a surface: a face and barycentric coordinates for each."""
    areas = np.linalg.norm(face_normals(vertices, faces), axis=1)
    face = rng.choice(len(faces), size=count, p=areas / areas.sum())
    root, along = np.sqrt(rng.random(count)), rng.random(count)
    return face, np.column_stack([1 - root, root * (1 - along), root * along])


def referenced(faces: Int[np.ndarray, "faces 3"], count: int) -> Bool[np.ndarray, " vertices"]:
    """Tell which of `count` vertices belong to a face."""
    used = np.zeros(count, bool)
    used[faces] = True
    return used


def scale_to_unit_area(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, "3"], float]:
    """Centre a surface and scale it to area 1; also give what undoes it: centre and scale."""
    centre = vertices.mean(axis=0)
    scale = float(np.sqrt(surface_area(vertices, faces)))
    return (vertices - centre) / scale, centre, scale

"""Shapes for the demo figures: distance functions to blend, polygonise, cut along lines, colour."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import fast_simplification
import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.sparse import coo_matrix
from skimage.measure import marching_cubes

Points = Float[np.ndarray, "points 3"]
Values = Float[np.ndarray, " points"]
Shape = Callable[[Points], Values]  # signed distance, about: negative inside
Triangles = tuple[Float[np.ndarray, "vertices 3"], Int[np.ndarray, "faces 3"]]


@dataclass(frozen=True)
class Piece:
    """One part of a figure: a surface of one material, a colour in sRGB 0-255."""

    name: str
    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    colour: tuple[int, int, int]
    normals: Float[np.ndarray, "vertices 3"] | None = None  # None: from the faces


def ellipsoid(centre: Sequence[float], radii: Sequence[float]) -> Shape:
    """Give an ellipsoid along the axes; its distance is exact near its surface only."""
    middle, size = np.array(centre), np.array(radii)

    def distance(points: Points) -> Values:
        scaled = (points - middle) / size
        radius = np.linalg.norm(scaled, axis=-1)
        slope = np.linalg.norm(scaled / size, axis=-1)
        return radius * (radius - 1.0) / np.maximum(slope, 1e-9)

    return distance


def limb(first: Sequence[float], second: Sequence[float], radii: tuple[float, float]) -> Shape:
    """Give a tapered capsule from one point to another."""
    start, across = np.array(first), np.subtract(second, first)

    def distance(points: Points) -> Values:
        along = np.clip((points - start) @ across / (across @ across), 0.0, 1.0)
        nearest = start + along[..., None] * across
        radius = radii[0] + along * (radii[1] - radii[0])
        return np.linalg.norm(points - nearest, axis=-1) - radius

    return distance


def chain(points: Sequence[Sequence[float]], radii: Sequence[float]) -> Shape:
    """Give tapered capsules from point to point."""
    pairs = zip(points[:-1], points[1:], radii[:-1], radii[1:], strict=True)
    return union(*(limb(a, b, (r, s)) for a, b, r, s in pairs))


def box(centre: Sequence[float], half: Sequence[float], rounding: float) -> Shape:
    """Give a box along the axes with round edges."""
    middle, size = np.array(centre), np.array(half) - rounding

    def distance(points: Points) -> Values:
        outside = np.abs(points - middle) - size
        inner = np.minimum(outside.max(axis=-1), 0.0)
        return np.linalg.norm(np.maximum(outside, 0.0), axis=-1) + inner - rounding

    return distance


def ring(centre: Sequence[float], radii: tuple[float, float], thickness: float) -> Shape:
    """Give a level ring, elliptic: radii along X and Z."""
    middle, (wide, deep) = np.array(centre), radii

    def distance(points: Points) -> Values:
        x, y, z = (points - middle).T
        flat = (np.hypot(x / wide, z / deep) - 1.0) * min(wide, deep)
        return np.hypot(flat, y) - thickness

    return distance


def union(*shapes: Shape, blend: float = 0.0) -> Shape:
    """Join shapes; their meeting is filled smoothly over a width of `blend` metres."""

    def distance(points: Points) -> Values:
        result = shapes[0](points)
        for shape in shapes[1:]:
            other = shape(points)
            gap = np.maximum(blend - np.abs(result - other), 0.0)
            result = np.minimum(result, other) - gap**2 / (4 * blend or 1.0)
        return result

    return distance


def without(shape: Shape, cutter: Shape) -> Shape:
    """Take the cutter away from a shape."""
    return lambda points: np.maximum(shape(points), -cutter(points))


def mirrored(shape: Shape) -> Shape:
    """Join a shape of the left side with its mirror image."""
    return lambda points: np.minimum(shape(points), shape(points * [-1.0, 1.0, 1.0]))


def flipped(piece: Piece, name: str) -> Piece:
    """Give the mirror image of a piece."""
    mirror = np.array([-1.0, 1.0, 1.0])
    normals = None if piece.normals is None else piece.normals * mirror
    return Piece(name, piece.vertices * mirror, piece.faces[:, ::-1], piece.colour, normals)


def surface(
    shape: Shape, bounds: tuple[Sequence[float], Sequence[float]], step: float
) -> Triangles:
    """Polygonise a shape by marching cubes of edge `step`."""
    low, high = np.array(bounds[0]), np.array(bounds[1])
    axes = [np.arange(a, b + step, step) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = shape(grid.reshape(-1, 3)).reshape(grid.shape[:3])
    vertices, faces, _, _ = marching_cubes(values, 0.0, spacing=(step,) * 3)
    return vertices.astype(np.float64) + low, faces.astype(np.int64)


def decimated(triangles: Triangles, count: int) -> Triangles:
    """Simplify to about so many faces."""
    vertices, faces = fast_simplification.simplify(
        triangles[0].astype(np.float32), triangles[1].astype(np.int32), target_count=count
    )
    return vertices.astype(np.float64), faces.astype(np.int64)


def slope(shape: Shape, points: Points, *, step: float = 1e-4) -> Points:
    """Give the gradient of a shape's distance, by central differences."""
    offsets = np.eye(3) * step
    return np.stack([shape(points + o) - shape(points - o) for o in offsets], axis=1) / (2 * step)


def normals_of(shape: Shape, points: Points) -> Points:
    """Give unit normals on the surface of a shape."""
    gradient = slope(shape, points)
    return gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-12)


def relaxed(shape: Shape, triangles: Triangles, *, rounds: int = 6) -> Triangles:
    """Even out triangles: move each vertex to its neighbours' mean, then back."""
    vertices, faces = triangles
    rows, columns = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    ones = np.ones(len(rows))
    links = coo_matrix((ones, (rows, columns)), shape=(len(vertices),) * 2).tocsr()
    degrees = np.asarray(links.sum(axis=1))
    for _ in range(rounds):
        vertices = (vertices + links @ vertices / degrees) / 2
        for _ in range(2):
            gradient = slope(shape, vertices)
            squared = np.maximum((gradient**2).sum(axis=1), 0.04)
            vertices = vertices - (shape(vertices) / squared)[:, None] * gradient
    return vertices, faces


def sculpted(
    name: str,
    shape: Shape,
    step: float,
    *,
    bounds: tuple[Sequence[float], Sequence[float]],
    colour: tuple[int, int, int],
    faces: int = 0,
) -> Piece:
    """Make a closed piece of a shape: polygonise at `step`, simplify to `faces`, even out."""
    triangles = surface(shape, bounds, step)
    if 0 < faces < len(triangles[1]):
        triangles = decimated(triangles, faces)
    vertices, corners = relaxed(shape, triangles)
    return Piece(name, vertices, corners, colour, normals_of(shape, vertices))


def height_on(shape: Shape, x: float, y: float, *, far: float = 0.6) -> float:
    """Find how far forward (+Z) a shape reaches at a place of the frontal plane."""
    inside, outside = 0.0, far
    for _ in range(40):
        middle = (inside + outside) / 2
        is_inside = shape(np.array([[x, y, middle]]))[0] < 0
        inside, outside = (middle, outside) if is_inside else (inside, middle)
    return inside


def cut(
    values: Float[np.ndarray, "vertices columns"],
    faces: Int[np.ndarray, "faces 3"],
    field: Float[np.ndarray, " vertices"],
) -> tuple[Float[np.ndarray, "more columns"], Int[np.ndarray, "pieces 3"]]:
    """Cut a surface along the line where a field is zero, so that no face crosses it.

    Args:
        values: position and whatever else belongs to a vertex; new vertices are interpolated.
        faces: the triangles.
        field: signed values at the vertices; a crossing close to a vertex moves into it.

    Returns:
        values and faces with the new vertices.
    """
    field = field.copy()
    edges = np.unique(np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    for start, end in (edges.T, edges[:, ::-1].T):
        step = field[start] - field[end]
        share = field[start] / np.where(step == 0, np.inf, step)
        field[start[(share > 0) & (share < 0.12)]] = 0.0
    crossed = edges[field[edges[:, 0]] * field[edges[:, 1]] < 0]
    share = (field[crossed[:, 0]] / (field[crossed[:, 0]] - field[crossed[:, 1]]))[:, None]
    added = values[crossed[:, 0]] * (1 - share) + values[crossed[:, 1]] * share
    at = {(int(a), int(b)): len(values) + i for i, (a, b) in enumerate(crossed)}
    pieces = [piece for face in faces.tolist() for piece in _split(tuple(face), at)]
    return np.concatenate([values, added]), np.array(pieces, np.int64)


def _split(face: tuple[int, int, int], at: dict[tuple[int, int], int]) -> list[tuple[int, ...]]:
    """Cut one face at the points on its edges: into one, two or three."""
    on = [at.get((min(a, b), max(a, b))) for a, b in zip(face, face[1:] + face[:1], strict=True)]
    count = sum(point is not None for point in on)
    if count == 0:
        return [face]
    turn = on.index(None) if count == 2 else next(i for i in range(3) if on[i] is not None)
    a, b, c = face[turn:] + face[:turn]
    ab, bc, ca = on[turn:] + on[:turn]
    if count == 1:
        return [(a, ab, c), (ab, b, c)]
    return [(c, ca, bc), (a, b, bc), (a, bc, ca)]


def part_of(
    piece: Piece, name: str, faces: Int[np.ndarray, "faces 3"], colour: tuple[int, int, int]
) -> Piece:
    """Give some faces of a piece, with the vertices that they use."""
    used, numbers = np.unique(faces, return_inverse=True)
    normals = None if piece.normals is None else piece.normals[used]
    return Piece(name, piece.vertices[used], numbers.reshape(-1, 3), colour, normals)


def write_figure(path: str, pieces: Sequence[Piece]) -> None:
    """Write pieces as one GLB with a plain material each; equal pieces give equal bytes."""
    scene = trimesh.Scene()
    for piece in pieces:
        material = trimesh.visual.material.PBRMaterial(
            name=piece.name,
            baseColorFactor=[round(255 * (c / 255) ** 2.2) for c in piece.colour] + [255],
            metallicFactor=0.0,
            roughnessFactor=0.8,
            doubleSided=True,
        )
        mesh = trimesh.Trimesh(
            piece.vertices.astype(np.float32),
            piece.faces,
            vertex_normals=piece.normals,
            visual=trimesh.visual.TextureVisuals(material=material),
            process=False,
        )
        scene.add_geometry(mesh, node_name=piece.name, geom_name=piece.name)
    scene.export(path, include_normals=True)

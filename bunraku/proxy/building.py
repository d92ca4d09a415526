"""Build the closed proxy of a figure (winding number, marching cubes, decimation)."""

from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from bunraku import meshes
from bunraku.errors import doubt
from bunraku.proxy import closed, clouds, solids, surfaces, voxels
from bunraku.types import Mesh

MOST_FACES = 200_000  # of a figure that is looked at in full
MOST_POINTS = 30_000  # of a cloud that is looked at in full
BLOCK = 100_000  # vertices that are placed on a proxy at a time
FINENESS = (8, 4, 2, 1)  # nodes that the surface touches, per vertex of the proxy, in turn
THICKNESS = 1.8  # of a surface without inside, in cells: no node spacing slips through


@dataclass(frozen=True, eq=False)
class Proxy:
    """A closed mesh of one part in a figure's place, and where the figure sits on it."""

    mesh: Mesh  # closed, manifold, one part, facing outwards
    corners: Int[np.ndarray, "vertices 3"]  # proxy vertices around each vertex of the figure
    barycentric: Float[np.ndarray, "vertices 3"]  # their shares


@dataclass(frozen=True, eq=False)
class Soup:
    """Points of a figure's surface, in whatever form it came, and how it winds around others."""

    points: Float[np.ndarray, "points 3"]
    normals: Float[np.ndarray, "points 3"]
    winding: voxels.Winding
    distance: surfaces.Distance
    spacing: float = 0.0  # metres between neighbouring points, if there are no others


def build_proxy(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    *,
    vertex_count: int = 4000,
) -> Proxy:
    """Wrap a figure, whatever its parts and holes, in a closed mesh of about one size.

    Args:
        vertices: the figure, as stored.
        faces: its triangles; none for a point cloud.
        vertex_count: vertices that the proxy should have, about. A closed figure of one part that
            has half to double as many is its own proxy.

    Returns:
        the proxy, and where each of `vertices`, unwelded, lies on it; equal places lie equally.

    Raises:
        ValueError: if the figure has no extent.
    """
    welded, kept, welded_of = meshes.weld(vertices, faces)
    if len(welded) < 4 or (np.ptp(welded, axis=0) == 0).sum() > 1:
        raise ValueError(
            f"its {len(vertices)} vertices are at {len(welded)} different places, or on one line; "
            "export the whole surface of a body"
        )
    mesh = build_mesh(Mesh(welded, kept), vertex_count)
    return place(welded, welded_of, mesh)


def place(
    welded: Float[np.ndarray, "welded 3"], welded_of: Int[np.ndarray, " vertices"], mesh: Mesh
) -> Proxy:
    """Find where each vertex lies on a proxy, block by block: a million at once fill the memory."""
    blocks = np.array_split(welded, len(welded) // BLOCK + 1)
    found = [meshes.closest_points(block, mesh.vertices, mesh.faces)[:2] for block in blocks]
    face = np.concatenate([one for one, _ in found])
    barycentric = np.concatenate([one for _, one in found])
    return Proxy(mesh, mesh.faces[face[welded_of]], barycentric[welded_of])


def build_mesh(figure: Mesh, vertex_count: int) -> Mesh:
    """Take the figure's own closed body if it has one, else wrap it anew."""
    if meshes.surface_area(figure.vertices, figure.faces) <= 0:
        return wrap(soup_of_points(figure.vertices), vertex_count)
    if len(figure.faces) > MOST_FACES:
        figure = closed.simplify(figure, MOST_FACES)
    body = closed.closed_body(figure)
    mesh = None if body is None else closed.resample(body, vertex_count)
    return wrap(soup_of_faces(figure), vertex_count) if mesh is None else mesh


def soup_of_faces(figure: Mesh, *, samples: int = 200_000) -> Soup:
    """Draw points from a mesh, its parts turned to face outwards."""
    faces = face_outwards(figure.vertices, figure.faces)
    rng = np.random.default_rng(0)
    face, barycentric = meshes.sample_surface(figure.vertices, faces, samples, rng)
    normals = meshes.face_normals(figure.vertices, faces)[face]
    tree = igl.FastWindingNumberBVH()
    tree.init(figure.vertices, faces)

    def distance(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        return np.sqrt(igl.point_mesh_squared_distance(points, figure.vertices, faces)[0])

    return Soup(
        meshes.interpolate(figure.vertices, faces[face], barycentric),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        tree.winding_number,
        distance,
    )


def soup_of_points(points: Float[np.ndarray, "points 3"]) -> Soup:
    """Take a point cloud as small discs, at most MOST_POINTS of them, turned to face outwards."""
    rng = np.random.default_rng(0)
    if len(points) > MOST_POINTS:
        points = points[np.sort(rng.choice(len(points), MOST_POINTS, replace=False))]
    tree = cKDTree(points)
    apart = clouds.spacings(points, tree)
    spacing, areas = float(np.median(apart)), np.pi * apart**2 / 6
    normals = clouds.oriented_normals(points, tree, spacing)

    def distance(places: Float[np.ndarray, "places 3"]) -> Float[np.ndarray, " places"]:
        nearest = tree.query(places)[1]
        return np.abs(np.einsum("pc,pc->p", places - points[nearest], normals[nearest]))

    return Soup(
        points,
        normals,
        lambda places: igl.fast_winding_number(points, normals, areas, places),
        distance,
        spacing,
    )


def face_outwards(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Int[np.ndarray, "faces 3"]:
    """Turn every part of a mesh so that its faces agree and look away from its middle."""
    oriented, patch = igl.bfs_orient(np.ascontiguousarray(faces))
    turned = oriented.astype(np.int64)  # from C "long long", which the shape checker refuses
    count = int(patch.max()) + 1
    corners = vertices[turned]
    sizes = np.bincount(patch, minlength=count)
    middle = [np.bincount(patch, corners[:, :, i].mean(axis=1), count) / sizes for i in range(3)]
    first, second, third = (corners - np.stack(middle, axis=1)[patch][:, None]).transpose(1, 0, 2)
    volume = np.bincount(patch, np.einsum("fc,fc->f", first, np.cross(second, third)), count)
    return np.where((volume < 0)[patch][:, None], turned[:, ::-1], turned)


def fitting_grid(soup: Soup, vertex_count: int, fineness: int) -> voxels.Grid:
    """Choose the cell so that the surface touches about `fineness` nodes per vertex.

    Neither finer than the soup, nor so fine or coarse that the figure would not be known.
    """
    coarse = voxels.grid_around(soup.points, 64)
    count = int(voxels.touched_nodes(soup.points, coarse).sum())
    wanted = 64 * np.sqrt(fineness * vertex_count / count)
    cells = float(np.clip(wanted, 6 * fineness, 20 * fineness))
    if soup.spacing > 0:
        cells = min(cells, float(np.ptp(soup.points, axis=0).max()) / soup.spacing)
    return voxels.grid_around(soup.points, max(int(cells), 8))


def wrap(soup: Soup, vertex_count: int) -> Mesh:
    """Triangulate the border of the figure's solid anew, with about this many vertices.

    The border is clean, whatever the figure; if bringing it to size spoils it, a coarser one is
    tried, and in the last resort the coarsest is taken as it is.
    """
    fine = border(soup, vertex_count, FINENESS[0])
    for fineness in FINENESS[1:]:
        mesh = closed.resample(fine, vertex_count)
        if mesh is not None:
            return mesh
        doubt("the proxy was spoilt when simplified; trying a coarser grid")
        fine = border(soup, vertex_count, fineness)
    return fine


def border(soup: Soup, vertex_count: int, fineness: int) -> Mesh:
    """March around the figure's solid on a grid so much finer than the proxy shall be."""
    grid = fitting_grid(soup, vertex_count, fineness)
    inside = voxels.inside_nodes(soup.winding, soup.points, grid)
    sheet = voxels.sheet_samples(soup.points, soup.normals, inside, grid)
    solid = solids.solid_nodes(voxels.thicken(inside, sheet, grid, THICKNESS))
    field = surfaces.signed_distance(solid, soup.distance, sheet, grid, THICKNESS)
    return surfaces.march(field, grid)

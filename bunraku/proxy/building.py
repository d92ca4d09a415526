"""Build the closed proxy of a figure (winding number, marching cubes, decimation)."""

from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Float, Int

from bunraku import meshes
from bunraku.proxy import closed, solids, surfaces, voxels
from bunraku.types import Mesh

MOST_FACES = 200_000  # of a figure that is looked at in full
THICKNESS = 1.8  # of a surface without inside, in cells: no node spacing slips through


@dataclass(frozen=True, eq=False)
class Proxy:
    """A closed mesh of one part in a figure's place, and where the figure sits on it."""

    mesh: Mesh  # closed, manifold, one part, facing outwards
    corners: Int[np.ndarray, "vertices 3"]  # proxy vertices around each vertex of the figure
    barycentric: Float[np.ndarray, "vertices 3"]  # their shares


def build_proxy(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    *,
    vertex_count: int = 4000,
) -> Proxy:
    """Wrap a figure, whatever its parts and holes, in a closed mesh of about one size.

    Args:
        vertices: the figure, as stored.
        faces: its triangles.
        vertex_count: vertices that the proxy should have, about.

    Returns:
        the proxy, and where each of `vertices`, unwelded, lies on it.
    """
    welded, kept, welded_of = meshes.weld(vertices, faces)
    figure = Mesh(welded, kept)
    if len(kept) > MOST_FACES:
        figure = closed.simplify(figure, MOST_FACES)
    body = closed.closed_body(figure)
    mesh = None if body is None else closed.resample(body, vertex_count)
    if mesh is None:
        mesh = wrap(figure, vertex_count)
    face, barycentric, _ = meshes.closest_points(welded, mesh.vertices, mesh.faces)
    return Proxy(mesh, mesh.faces[face][welded_of], barycentric[welded_of])


def face_outwards(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Int[np.ndarray, "faces 3"]:
    """Turn every part of a mesh so that its faces agree and look away from its middle."""
    turned, patch = igl.bfs_orient(np.ascontiguousarray(faces))
    turned = turned.astype(np.int64)  # from C "long long", which the shape checker refuses
    first, second, third = vertices[turned].transpose(1, 0, 2)
    count = int(patch.max()) + 1
    middle = (
        np.stack(
            [np.bincount(patch, vertices[turned].mean(axis=1)[:, i], count) for i in range(3)],
            axis=1,
        )
        / np.bincount(patch, minlength=count)[:, None]
    )
    first, second, third = first - middle[patch], second - middle[patch], third - middle[patch]
    volume = np.bincount(patch, np.einsum("fc,fc->f", first, np.cross(second, third)), count)
    return np.where((volume < 0)[patch][:, None], turned[:, ::-1], turned)


def fitting_grid(samples: Float[np.ndarray, "samples 3"], touched: int) -> voxels.Grid:
    """Choose the cell so that the surface touches about this many nodes."""
    coarse = voxels.grid_around(samples, 64)
    count = int(voxels.touched_nodes(samples, coarse).sum())
    cells = int(np.clip(64 * np.sqrt(touched / count), 48, 160))
    return voxels.grid_around(samples, cells)


def wrap(figure: Mesh, vertex_count: int) -> Mesh:
    """Triangulate the border of the figure's solid anew, with about this many vertices."""
    figure = Mesh(figure.vertices, face_outwards(figure.vertices, figure.faces))
    rng = np.random.default_rng(0)
    face, barycentric = meshes.sample_surface(figure.vertices, figure.faces, 200_000, rng)
    samples = meshes.interpolate(figure.vertices, figure.faces[face], barycentric)
    grid = fitting_grid(samples, 8 * vertex_count)
    normals = meshes.face_normals(figure.vertices, figure.faces)[face]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    def winding(points: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, " points"]:
        return igl.fast_winding_number(figure.vertices, figure.faces, points)

    inside = voxels.inside_nodes(winding, samples, grid)
    sheet = voxels.sheet_samples(samples, normals, inside, grid)
    solid = solids.solid_nodes(voxels.thicken(inside, sheet, grid, THICKNESS))
    field = surfaces.signed_distance(solid, figure, sheet, grid, THICKNESS)
    fine = surfaces.march(field, grid)
    coarse = closed.collapse_short_edges(fine, vertex_count)
    return fine if coarse is None else coarse

"""A mesh made ready for matching: scaled to area 1, with normals, basis and spread samples."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku.meshes import farthest_points, surface_area, vertex_normals
from bunraku.spectral import Basis, eigenbasis, laplacian
from bunraku.types import Mesh


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh scaled to area 1 about its centre, and what matching asks of it again and again."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    normals: Float[np.ndarray, "vertices 3"]
    basis: Basis
    samples: Int[np.ndarray, " samples"]  # vertices spread evenly, the extremities first
    areas: Float[np.ndarray, " samples"]  # area nearest to each sample, summing to 1
    sampled_faces: Int[np.ndarray, "some_faces 3"]  # the faces around the samples


def prepare_surface(mesh: Mesh, *, modes: int, samples: int = 600) -> Surface:
    """Scale a mesh to area 1, centre it, and compute its normals, basis and samples.

    Raises:
        ValueError: if it has too few vertices for the basis, or no area.
    """
    basis = eigenbasis(mesh.vertices, mesh.faces, count=modes)
    centre = basis.mass @ mesh.vertices
    if len(mesh.faces):
        area = surface_area(mesh.vertices, mesh.faces)
    else:
        area = float(laplacian(mesh.vertices, mesh.faces)[1].sum())
    vertices = (mesh.vertices - centre) / np.sqrt(area)
    chosen = farthest_points(vertices, samples)
    sampled = np.zeros(len(vertices), bool)
    sampled[chosen] = True
    return Surface(
        vertices,
        mesh.faces,
        vertex_normals(vertices, mesh.faces),
        basis,
        chosen,
        np.bincount(KDTree(vertices[chosen]).query(vertices)[1], basis.mass, len(chosen)),
        mesh.faces[sampled[mesh.faces].any(axis=1)],
    )


def without_faces(surface: Surface) -> Surface:
    """Forget faces and normals, to compare a surface with a point cloud on equal terms."""
    none = np.zeros((0, 3), np.int64)
    normals = np.zeros_like(surface.normals)
    return replace(surface, faces=none, sampled_faces=none, normals=normals)

"""A mesh made ready for matching: scaled to area 1, with normals, basis and spread samples."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku.meshes import farthest_points, surface_area, vertex_normals
from bunraku.spectral import Basis, eigenbasis
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
    scale = np.sqrt(surface_area(mesh.vertices, mesh.faces)) if len(mesh.faces) else 1.0
    vertices = (mesh.vertices - centre) / scale
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

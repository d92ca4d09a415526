"""Free the posed puppet's vertices to meet the surface, held together by a bi-Laplacian.

After Amberg et al. 2007, "Optimal step nonrigid ICP algorithms for surface registration", with the
thin-plate energy of the difference from a reference in place of local affine maps.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from bunraku.meshes import vertex_areas, vertex_normals
from bunraku.registration.correspondence import Surface, features, robust_weights
from bunraku.spectral import laplacian


@dataclass(frozen=True)
class Reach:
    """Which pairs a non-rigid step believes, in units of sqrt(area)."""

    normals: float = 0.05  # weight of normals in the search
    width: float = 0.05  # of the robust weight
    gate: float = 0.08  # pairs farther apart are dropped
    agreement: float = 0.5  # least dot product of normals
    tangent: float = 0.03  # nearer than this, slide on the tangent plane


def refine(
    vertices: Float[np.ndarray, "vertices 3"],
    reference: Float[np.ndarray, "vertices 3"],
    faces: np.ndarray,
    surface: Surface,
    *,
    stiffness: Float[np.ndarray, " steps"],
    reach: Reach = Reach(),
) -> Float[np.ndarray, "vertices 3"]:
    """Pull vertices onto a surface in steps of falling stiffness.

    Args:
        vertices: where they start.
        reference: shape whose bending the result keeps; areas in units of the surface's.
        faces: triangles of both.
        surface: what to meet.
        stiffness: weight of the bi-Laplacian, step by step.
        reach: which pairs to believe.

    Returns:
        the refined vertices.
    """
    bending = bilaplacian(reference, faces)
    areas = vertex_areas(reference, faces)
    goal = cKDTree(features(surface.vertices, surface.normals, reach.normals))
    for stiff in stiffness:
        wanted, weight = pull(vertices, faces, areas, surface, goal, reach=reach)
        held = stiff * (bending @ reference)
        system = (diags(weight + 1e-9) + stiff * bending).tocsc()
        factor = splu(
            system,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        vertices = factor.solve(wanted + 1e-9 * reference + held)
    return vertices


def bilaplacian(vertices: Float[np.ndarray, "vertices 3"], faces: np.ndarray) -> csc_matrix:
    """Build L M^-1 L, the thin-plate energy of a function on the surface."""
    stiffness, mass = laplacian(vertices, faces)
    return (stiffness @ diags(1.0 / mass) @ stiffness).tocsc()


def pull(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: np.ndarray,
    areas: Float[np.ndarray, " vertices"],
    surface: Surface,
    goal: cKDTree,
    *,
    reach: Reach,
) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, " vertices"]]:
    """Say where each vertex is wanted (times its weight), and how much, from pairs both ways."""
    normals = vertex_normals(vertices, faces)
    moving = features(vertices, normals, reach.normals)
    distance, nearest = goal.query(moving)
    meant = surface.vertices[nearest]
    believed = believe(distance, normals, surface.normals[nearest], reach)
    weight = areas * believed
    to_plane = np.einsum("va,va->v", vertices - meant, surface.normals[nearest])
    slid = vertices - to_plane[:, None] * surface.normals[nearest]
    near = np.linalg.norm(slid - meant, axis=1) < reach.tangent
    wanted = weight[:, None] * np.where(near[:, None], slid, meant)
    distance, asked = cKDTree(moving).query(goal.data)
    back = surface.areas * believe(distance, normals[asked], surface.normals, reach)
    count = len(vertices)
    for axis in range(3):
        wanted[:, axis] += np.bincount(asked, back * surface.vertices[:, axis], count)
    return wanted, weight + np.bincount(asked, back, count)


def believe(
    distance: Float[np.ndarray, " pairs"],
    normals: Float[np.ndarray, "pairs 3"],
    others: Float[np.ndarray, "pairs 3"],
    reach: Reach,
) -> Float[np.ndarray, " pairs"]:
    """Weigh pairs: near ones whose normals agree."""
    agree = np.einsum("va,va->v", normals, others) > reach.agreement
    kept = agree & (distance < reach.gate)
    return np.asarray(kept * robust_weights(distance**2, reach.width))

"""Carry skinning weights from a rigged source to a target.

    carried = mapped_coordinates(source_basis, target_basis, matrix, source_vertices)  # Eqs. 7-9
    weights = transfer_to_surface(source_weights, source_vertices, source_faces, carried)

The paper compares three transfers, all here under the name its Table 1 gives them: functional
("function"), point to point ("p2p") and intrinsic-extrinsic (Eq. 10). Equation numbers: Musoni et
al. 2021, "Reposing and retargeting unrigged characters with intrinsic-extrinsic transfer".
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku.meshes import closest_points, interpolate
from bunraku.proxy import Proxy, lift_weights
from bunraku.registration.body import Body
from bunraku.registration.search import Registration
from bunraku.skinning import keep_influences
from bunraku.spectral import Basis, project
from bunraku.types import Mesh


def transfer_by_function(
    weights: Float[np.ndarray, "source_vertices joints"],
    source: Basis,
    target: Basis,
    matrix: Float[np.ndarray, "target_functions source_functions"],
) -> Float[np.ndarray, "target_vertices joints"]:
    """Map each joint's weights as a function, W_S = Phi_S C Phi_T^+ W_T ("function").

    The truncated basis rings: the result is smooth, but has negative entries and rows that do not
    sum to 1. It is returned as it comes, because the paper measures it so; for a skin, pass it
    through `skinning.keep_influences`.
    """
    rows, columns = matrix.shape
    return target.functions[:, :rows] @ (matrix @ project(source.first(columns), weights))


def transfer_by_points(
    weights: Float[np.ndarray, "source_vertices joints"],
    point_map: Int[np.ndarray, " target_vertices"],
) -> Float[np.ndarray, "target_vertices joints"]:
    """Copy to each target vertex the weights of its source vertex, W_S = Pi W_T ("p2p")."""
    return weights[point_map]


def transfer_nearest(
    weights: Float[np.ndarray, "source_vertices joints"],
    source_vertices: Float[np.ndarray, "source_vertices 3"],
    carried: Float[np.ndarray, "target_vertices 3"],
) -> Float[np.ndarray, "target_vertices joints"]:
    """Copy the weights of the source vertex nearest in space (Eq. 10, the paper's form).

    Args:
        source_vertices: the source as it stands.
        carried: where each target vertex lies on the source, in the same frame and unit; from
            `matching.mapped_coordinates` (Eq. 9).
    """
    return weights[KDTree(source_vertices).query(carried)[1]]


def transfer_to_surface(
    weights: Float[np.ndarray, "source_vertices joints"],
    source_vertices: Float[np.ndarray, "source_vertices 3"],
    source_faces: Int[np.ndarray, "source_faces 3"],
    carried: Float[np.ndarray, "target_vertices 3"],
) -> Float[np.ndarray, "target_vertices joints"]:
    """Blend the weights of the source surface's nearest point.

    Paper: the nearest vertex (Eq. 10). We: the nearest point of the surface, by barycentric
    coordinates, because the paper's form depends on the source's triangulation.

    Args:
        source_vertices: the source as it stands.
        carried: where each target vertex lies on the source, in the same frame and unit.
    """
    face, barycentric, _ = closest_points(carried, source_vertices, source_faces)
    return interpolate(weights, source_faces[face], barycentric)


def skin_from_registration(
    body: Body, registration: Registration, target: Proxy, figure: Mesh
) -> Float[np.ndarray, "vertices joints"]:
    """Read the skin off the registered source, lift it to the figure, keep four influences.

    Paper: nearest vertex of the mapped template (Eq. 10). We: nearest point of the source's
    surface registered onto the figure, because the map is the bottleneck (docs/log.md).
    """
    faces = body.proxy.mesh.faces
    on_proxy = transfer_to_surface(body.weights, registration.fitted, faces, target.mesh.vertices)
    return keep_influences(lift_weights(target, on_proxy, figure.vertices, figure.faces))

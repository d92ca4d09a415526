"""The Laplace-Beltrami operator of a surface, its eigenfunctions, and signatures made of them.

    basis = eigenbasis(mesh.vertices, mesh.faces, count=100)
    coefficients = project(basis, mesh.vertices)                                  # Eq. 7
    smooth = basis.functions @ coefficients

Every basis belongs to the surface scaled to area 1: values have no unit, and bases of figures
of different size compare. Equation numbers: Musoni et al. 2021, "Reposing and retargeting unrigged
characters with intrinsic-extrinsic transfer".
"""

import logging
from dataclasses import dataclass

import fast_simplification
import numpy as np
import robust_laplacian
from jaxtyping import Float, Int
from scipy.linalg import eigh
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh, splu
from threadpoolctl import threadpool_limits

from bunraku.meshes import closest_points, interpolate, referenced
from bunraku.types import check_shape

LOGGER = logging.getLogger(__name__)
SHIFTS = (1e-2, 1.0, 100.0)  # tried in turn until the factorisation succeeds
SPARE = 10  # functions computed on the coarse mesh beyond those wanted


@dataclass(frozen=True, eq=False)
class Basis:
    """The smoothest orthonormal functions on a surface scaled to area 1, smoothest first."""

    values: Float[np.ndarray, " functions"]  # eigenvalues, rising, the first 0
    functions: Float[np.ndarray, "vertices functions"]  # functions.T @ diag(mass) @ functions = I
    mass: Float[np.ndarray, " vertices"]  # area of each vertex, summing to 1

    def __post_init__(self) -> None:
        shape = len(self.mass), len(self.values)
        check_shape("functions", self.functions, shape, "one row per mass, one column per value")

    def first(self, count: int) -> "Basis":
        """Keep the `count` smoothest functions."""
        return Basis(self.values[:count], self.functions[:, :count], self.mass)


def laplacian(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> tuple[csc_matrix, Float[np.ndarray, " vertices"]]:
    """Build the intrinsic-Delaunay Laplacian, positive semi-definite, and the lumped mass.

    Args:
        faces: triangles, manifold or not; none at all makes the points a point cloud.

    Returns:
        the stiffness matrix (no unit) and the area of each vertex, in square metres.

    Reference:
        Sharp and Crane 2020, "A Laplacian for Nonmanifold Triangle Meshes".
    """
    if len(faces):
        stiffness, mass = robust_laplacian.mesh_laplacian(vertices, faces)
    else:
        stiffness, mass = robust_laplacian.point_cloud_laplacian(vertices)
    return csc_matrix(stiffness), np.asarray(mass.diagonal(), np.float64)


def eigenbasis(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    *,
    count: int,
    exact_below: int = 12_000,
) -> Basis:
    """Compute the `count` smoothest eigenfunctions of a surface, L phi = value M phi.

    Large meshes take theirs from a coarse copy: prolongation, one inverse iteration and
    Rayleigh-Ritz. Their eigenvalues are then too high by up to .6 %, most at the end.

    Args:
        faces: triangles; none makes the points a point cloud.
        count: functions wanted, the constant one included; fewer than the used vertices.
        exact_below: meshes with more vertices go through the coarse copy.

    Returns:
        the basis, the same on every call; the entry of largest magnitude of each function is
        positive. Vertices without a face get zeros.

    Raises:
        ValueError: if the surface has too few vertices for `count` functions, or no area.
    """
    stiffness, mass = laplacian(vertices, faces)
    touched = referenced(faces, len(vertices)) if len(faces) else np.ones(len(vertices), bool)
    mass = np.where(touched, mass, 0.0)
    used = np.flatnonzero(mass > 0)
    if len(used) <= count:
        raise ValueError(
            f"{count} eigenfunctions need more than {count} vertices with area, "
            f"got {len(used)}: ask for fewer, or subdivide the mesh"
        )
    mass = mass / mass.sum()
    stiffness = stiffness[used][:, used]
    with threadpool_limits(1):
        if len(faces) and len(used) > exact_below:
            guess = prolonged_functions(vertices, faces, count + SPARE)[used]
            values, functions = improve_functions(stiffness, mass[used], guess)
            values, functions = values[:count], functions[:, :count]
        else:
            values, functions = solve_functions(stiffness, mass[used], count)
    functions = functions * np.sign(functions[np.abs(functions).argmax(axis=0), np.arange(count)])
    everywhere = np.zeros((len(vertices), count))
    everywhere[used] = functions
    return Basis(np.maximum(values, 0.0), everywhere, mass)


def factorise(stiffness: csc_matrix, mass: Float[np.ndarray, " vertices"]) -> tuple[SuperLU, float]:
    """Factorise L + shift M, with a larger shift where the matrix is singular."""
    for shift in SHIFTS:
        try:
            shifted = csc_matrix(stiffness + diags(shift * mass))
            factors = splu(
                shifted,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
            return factors, shift
        except RuntimeError:
            LOGGER.info("the Laplacian is singular at shift %g", shift)
    raise ValueError("the Laplacian is singular: the surface has no connected area to work on")


def solve_functions(
    stiffness: csc_matrix, mass: Float[np.ndarray, " vertices"], count: int
) -> tuple[Float[np.ndarray, " count"], Float[np.ndarray, "vertices count"]]:
    """Find the smoothest functions by Lanczos iteration on M^.5 (L + shift M)^-1 M^.5."""
    factors, shift = factorise(stiffness, mass)
    root = np.sqrt(mass)
    inverse = LinearOperator(
        stiffness.shape, matvec=lambda vector: root * factors.solve(root * vector), dtype=np.float64
    )
    start = np.random.default_rng(0).normal(size=len(mass))
    amounts, functions = eigsh(inverse, k=count, which="LM", v0=start)
    order = np.argsort(-amounts)
    return 1.0 / amounts[order] - shift, functions[:, order] / root[:, None]


def prolonged_functions(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    count: int,
    *,
    coarse_count: int = 3000,
) -> Float[np.ndarray, "vertices count"]:
    """Interpolate the eigenfunctions of a decimated copy at the nearest points of its surface."""
    wanted = 2 * max(coarse_count, 6 * count)  # a closed mesh has two faces a vertex
    share = 1.0 - min(1.0, wanted / len(faces))
    coarse_vertices, coarse_faces = fast_simplification.simplify(
        np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32), share
    )
    coarse_vertices, coarse_faces = coarse_vertices.astype(np.float64), coarse_faces.astype(int)
    coarse = eigenbasis(coarse_vertices, coarse_faces, count=count, exact_below=len(vertices))
    face, barycentric, _ = closest_points(vertices, coarse_vertices, coarse_faces)
    return interpolate(coarse.functions, coarse_faces[face], barycentric)


def improve_functions(
    stiffness: csc_matrix,
    mass: Float[np.ndarray, " vertices"],
    guess: Float[np.ndarray, "vertices count"],
) -> tuple[Float[np.ndarray, " count"], Float[np.ndarray, "vertices count"]]:
    """Take one inverse iteration from a guess, then the best functions in its span (Ritz)."""
    factors, _ = factorise(stiffness, mass)
    span = factors.solve(mass[:, None] * guess)
    span, _ = np.linalg.qr(np.sqrt(mass)[:, None] * span)
    span /= np.sqrt(mass)[:, None]
    values, mixture = eigh(span.T @ (stiffness @ span))
    return values, span @ mixture


def project(
    basis: Basis, values: Float[np.ndarray, "vertices *values"]
) -> Float[np.ndarray, "functions *values"]:
    """Give the coefficients of functions on the surface, Phi^T M f, which is Phi^+ f."""
    weighted = basis.mass.reshape(-1, *[1] * (values.ndim - 1)) * values
    return np.tensordot(basis.functions, weighted, axes=(0, 0))


def heat_kernel_signature(
    basis: Basis, times: Float[np.ndarray, " times"]
) -> Float[np.ndarray, "vertices times"]:
    """Tell how much heat stays at each vertex after each time, as a share of the surface's mean.

    Args:
        times: diffusion times on the surface of area 1, above 0; .005 to 1 shows limbs to body.

    Reference:
        Sun et al. 2009, "A concise and provably informative multi-scale signature".
    """
    decay = np.exp(-np.outer(basis.values, times))
    return (basis.functions**2 @ decay) / decay.sum(axis=0)


def wave_kernel_signature(
    basis: Basis, energies: int, *, spread: float = 7.0
) -> Float[np.ndarray, "vertices energies"]:
    """Tell where a particle of each energy is found, energies even on a logarithmic scale.

    Args:
        energies: how many; the range is that of the basis' values.
        spread: width of each energy band, in steps of the scale.

    Reference:
        Aubry et al. 2011, "The wave kernel signature" (variance 7 as in its section 4).
    """
    logs = np.log(np.maximum(basis.values[1:], 1e-6))
    scale = np.linspace(logs[0], logs[-1] / 1.02, energies)
    width = spread * (scale[1] - scale[0])
    bands = np.exp(-((scale - logs[:, None]) ** 2) / (2 * width**2))
    return (basis.functions[:, 1:] ** 2 @ bands) / bands.sum(axis=0)

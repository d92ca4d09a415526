"""Functional maps fitted to signatures, with a term that tells a surface from its mirror image.

Reference: Ovsjanikov et al. 2012, "Functional maps"; Ren et al. 2018, "Continuous and
orientation-preserving correspondences via functional maps", section 4.
"""

import numpy as np
from jaxtyping import Float, Int

from bunraku.matching.surfaces import Surface
from bunraku.spectral import Basis, project, wave_kernel_signature


def fit_descriptor_map(
    source: Surface, target: Surface, *, size: int = 30, energies: int = 100
) -> Float[np.ndarray, "size size"]:
    """Fit a functional map to wave kernel signatures; read it with `points_from_fitted_map`.

    Minimises ||C A - B||^2 + .01 ||C L_T - L_S C||^2 + .1 commutation with multiplication by each
    descriptor + 1 commutation with its orientation operator, each term scaled by its source's size.

    Returns:
        the map from source to target coefficients.
    """
    signatures = [
        normalised(surface.basis, wave_kernel_signature(surface.basis, energies))
        for surface in (source, target)
    ]
    own, other = (
        project(surface.basis.first(size), signature)
        for surface, signature in zip((source, target), signatures, strict=True)
    )
    normal = np.kron(np.eye(size), own @ own.T)
    gap = (target.basis.values[:size, None] - source.basis.values[:size]) ** 2
    normal += np.diag(1e-2 * (gap / np.linalg.norm(gap) ** 2 * size**2).ravel())
    few = [signature[:, 5::10] for signature in signatures]
    for operators, weight in ((multiplications, 0.1), (orientations, 1.0)):
        first, second = (
            operators(surface.basis.first(size), surface.faces, fields)
            for surface, fields in zip((source, target), few, strict=True)
        )
        normal += weight * commutation(first, second) / max((first**2).sum(), 1e-30) * size
    return np.linalg.solve(normal, (other @ own.T).ravel()).reshape(size, size)


def normalised(
    basis: Basis, signature: Float[np.ndarray, "vertices energies"]
) -> Float[np.ndarray, "vertices energies"]:
    """Divide each function by its norm on its own surface (MMMC21 divides both by one's)."""
    return signature / np.sqrt(basis.mass @ signature**2)


def multiplications(
    basis: Basis, faces: Int[np.ndarray, "faces 3"], fields: Float[np.ndarray, "vertices fields"]
) -> Float[np.ndarray, "fields functions functions"]:
    """Express multiplication by each field in the basis."""
    weighted = basis.mass[:, None] * fields
    return np.stack(
        [basis.functions.T @ (column[:, None] * basis.functions) for column in weighted.T]
    )


def orientations(
    basis: Basis, faces: Int[np.ndarray, "faces 3"], fields: Float[np.ndarray, "vertices fields"]
) -> Float[np.ndarray, "fields functions functions"]:
    """Express h -> normal . (grad f x grad h) in the basis, for each field f.

    On a triangle a b c of area A it is ((f_b - f_a)(h_c - h_a) - (f_c - f_a)(h_b - h_a)) / 2A;
    a mirror image changes its sign.
    """
    first, second, third = faces.T
    means = basis.functions[faces].mean(axis=1)
    along, across = (basis.functions[end] - basis.functions[first] for end in (second, third))
    rise, slope = (fields[end] - fields[first] for end in (second, third))
    return np.stack(
        [
            means.T @ (one[:, None] * across - two[:, None] * along) / 2
            for one, two in zip(rise.T, slope.T, strict=True)
        ]
    )


def commutation(
    source: Float[np.ndarray, "operators size size"],
    target: Float[np.ndarray, "operators size size"],
) -> Float[np.ndarray, "unknowns unknowns"]:
    """Give the quadratic form of sum ||C source - target C||^2 in the rows of C, one by one."""
    size = source.shape[1]
    square = np.einsum("nab,ncb->ac", source, source)
    opposite = np.einsum("nba,nbc->ac", target, target)
    mixed = np.einsum("nij,nkl->ikjl", target, source).reshape(size**2, size**2)
    return np.kron(np.eye(size), square) + np.kron(opposite, np.eye(size)) - mixed - mixed.T

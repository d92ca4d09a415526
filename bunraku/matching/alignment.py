"""Align two surfaces from one start by smooth shells: intrinsic and extrinsic at once.

Point map, functional map and a low-pass deformation of the source improve each other, from few
functions to more. Coordinates and normals tell left from right and front from back, which the
spectral embedding cannot; the embedding leads limbs that have moved far.

Reference: Eisenberger et al. 2020, "Smooth Shells: Multi-Scale Shape Registration with Functional
Maps". Paper: one start, with a Markov chain over its low-pass deformation. We: the same product
embedding at samples, from several given starts (`starts.py`), because figures stand upright.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from bunraku.matching.refinement import nearest_rows
from bunraku.matching.surfaces import Surface
from bunraku.meshes import vertex_normals
from bunraku.rotations import nearest_rotation

SIZES = tuple(range(4, 21, 2))  # functions used in each step
SPECTRAL = 0.04, 0.1  # weight of the spectral embedding against coordinates, first and last step
NORMAL = 0.2, 0.1  # weight of the normals


@dataclass(frozen=True, eq=False)
class Alignment:
    """A match between the samples of two surfaces, and the source deformed to lie on the target."""

    origin: str  # where it started from, for people
    source_from_target: Float[np.ndarray, "3 3"]  # rotation that the start gives the target
    matched: Int[np.ndarray, " target_samples"]  # source sample of each target sample
    moved: Float[np.ndarray, "source_vertices 3"]  # in the rotated target's frame
    size: int = 0  # functions used so far


def start_from_rotation(
    source: Surface, target: Surface, source_from_target: Float[np.ndarray, "3 3"], origin: str
) -> Alignment:
    """Rotate the target about its centre, then match each sample to the nearest in the source."""
    points = embed_samples(source, source.vertices, NORMAL[0])
    queries = embed_samples(target, target.vertices, NORMAL[0])
    turned = np.hstack([part @ source_from_target.T for part in np.split(queries, 2, axis=1)])
    return Alignment(origin, source_from_target, nearest_rows(points, turned), source.vertices)


def start_from_match(
    source: Surface, target: Surface, matched: Int[np.ndarray, " target_samples"], origin: str
) -> Alignment:
    """Rotate the target by the rotation that fits a given match best (Procrustes)."""
    pulled = source.vertices[source.samples[matched]]
    covariance = pulled.T @ (target.areas[:, None] * target.vertices[target.samples])
    return Alignment(origin, nearest_rotation(covariance), matched, source.vertices)


def align_shells(
    source: Surface, target: Surface, alignment: Alignment, *, sizes: Iterable[int] = SIZES
) -> Alignment:
    """Improve an alignment with rising numbers of functions, two rounds with each."""
    for size in sizes:
        progress = np.clip((size - SIZES[0]) / (SIZES[-1] - SIZES[0]), 0.0, 1.0)
        share, tilt = (first * (last / first) ** progress for first, last in (SPECTRAL, NORMAL))
        for _ in range(2):
            alignment = improve_alignment(source, target, alignment, size, share=share, tilt=tilt)
    return alignment


def improve_alignment(
    source: Surface, target: Surface, alignment: Alignment, size: int, *, share: float, tilt: float
) -> Alignment:
    """Take one round: functional map, match backwards, deformation, match forwards.

    Args:
        share: weight of the spectral embedding against coordinates of surfaces of area 1.
        tilt: weight of the normals.
    """
    turn = alignment.source_from_target
    places = target.vertices[target.samples] @ turn.T
    normals = target.normals[target.samples] @ turn.T
    matrix = fit_map(source, target, alignment.matched, size)
    carried = share * target.basis.functions[target.samples, :size] @ matrix
    own = share * source.basis.functions[source.samples, :size]
    queries = np.hstack([places, tilt * normals, carried])
    points = np.hstack([embed_samples(source, alignment.moved, tilt), own])
    moved = deform_towards(source, places[nearest_rows(queries, points)], size)
    points = np.hstack([embed_samples(source, moved, tilt), own])
    return replace(alignment, matched=nearest_rows(points, queries), moved=moved, size=size)


def embed_samples(
    surface: Surface, moved: Float[np.ndarray, "vertices 3"], tilt: float
) -> Float[np.ndarray, "samples 6"]:
    """Give coordinates and weighted normals of the samples of a deformed surface."""
    normals = vertex_normals(moved, surface.sampled_faces)
    return np.hstack([moved[surface.samples], tilt * normals[surface.samples]])


def fit_map(
    source: Surface, target: Surface, matched: Int[np.ndarray, " target_samples"], size: int
) -> Float[np.ndarray, "size size"]:
    """Build the functional map of a match between samples (Eq. 2, by least squares)."""
    return fit_functions(
        target.basis.functions[target.samples, :size],
        target.areas,
        source.basis.functions[source.samples[matched], :size],
        np.zeros(size),
    )


def deform_towards(
    source: Surface,
    goals: Float[np.ndarray, "source_samples 3"],
    size: int,
    *,
    stiffness: float = 1e-3,
) -> Float[np.ndarray, "source_vertices 3"]:
    """Move the source's samples to their goals, as far as the first functions can."""
    functions = source.basis.functions[:, :size]
    ridge = stiffness * source.basis.values[:size]
    shift = goals - source.vertices[source.samples]
    return source.vertices + functions @ fit_functions(
        functions[source.samples], source.areas, shift, ridge
    )


def fit_functions(
    functions: Float[np.ndarray, "samples functions"],
    areas: Float[np.ndarray, " samples"],
    values: Float[np.ndarray, "samples columns"],
    ridge: Float[np.ndarray, " functions"],
) -> Float[np.ndarray, "functions columns"]:
    """Give the coefficients that fit values at samples best, with a penalty per function."""
    weighted = areas[:, None] * functions
    return np.linalg.solve(weighted.T @ functions + np.diag(ridge), weighted.T @ values)

"""Candidate maps from plain alignment: smooth shells, started from each of several rotations.

Point map, functional map and a low-pass deformation of the source improve each other, from few
functions to more. Coordinates and normals tell left from right and front from back, which the
spectral embedding cannot; the embedding leads limbs that have moved far.

Reference: Eisenberger et al. 2020, "Smooth Shells: Multi-Scale Shape Registration with Functional
Maps". Paper: product embedding with a Markov chain over starts. We: the same embedding, sampled,
with equal weight of both directions, started from fixed rotations, because figures stand upright.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from bunraku.matching.refinement import nearest_rows
from bunraku.matching.surfaces import Surface
from bunraku.meshes import vertex_normals
from bunraku.rotations import vectors_to_matrices

SIZES = tuple(range(4, 21, 2))


def headings(up: Float[np.ndarray, "3"], count: int) -> Float[np.ndarray, "count 3 3"]:
    """Give `count` even turns about the upward axis, none first."""
    angles = np.arange(count) * (2 * np.pi / count)
    return vectors_to_matrices(angles[:, None] * up / np.linalg.norm(up))


def fit_functions(
    functions: Float[np.ndarray, "samples functions"],
    areas: Float[np.ndarray, " samples"],
    values: Float[np.ndarray, "samples columns"],
    ridge: Float[np.ndarray, " functions"],
) -> Float[np.ndarray, "functions columns"]:
    """Give the coefficients that fit values at samples best, with a penalty per function."""
    weighted = areas[:, None] * functions
    return np.linalg.solve(weighted.T @ functions + np.diag(ridge), weighted.T @ values)


def align_shells(
    source: Surface,
    target: Surface,
    source_from_target: Float[np.ndarray, "3 3"],
    *,
    sizes: Sequence[int] = SIZES,
    spectral: tuple[float, float] = (0.04, 0.1),
    upright: tuple[float, float] = (0.2, 0.1),
) -> tuple[Float[np.ndarray, "size size"], Float[np.ndarray, "source_vertices 3"]]:
    """Match the target to a smoothly deforming source, from one rotation.

    Args:
        source_from_target: rotation of the target before it is compared.
        sizes: functions used in each step.
        spectral: weight of the spectral embedding against coordinates (area 1), first and last.
        upright: weight of the normals, first and last.

    Returns:
        the functional map of the last size, and the vertices of the deformed source, which now
        lies on the target (in the target's rotation, area 1).
    """
    steps = len(sizes)
    places = target.vertices[target.samples] @ source_from_target.T
    turned = target.normals[target.samples] @ source_from_target.T
    moved, matched = source.vertices, None
    weights = np.geomspace(*spectral, steps), np.geomspace(*upright, steps)
    for size, share, tilt in zip(sizes, *weights, strict=True):
        for _ in range(2):
            queries = np.hstack([places, tilt * turned])
            points = embed_samples(source, moved, tilt)
            if matched is None:
                matched = nearest_rows(points, queries)
            matrix = fit_map(source, target, matched, size)
            carried = share * target.basis.functions[target.samples, :size] @ matrix
            queries = np.hstack([queries, carried])
            own = share * source.basis.functions[source.samples, :size]
            goals = places[nearest_rows(queries, np.hstack([points, own]))]
            moved = deform_towards(source, goals, size)
            matched = nearest_rows(np.hstack([embed_samples(source, moved, tilt), own]), queries)
    return fit_map(source, target, matched, size), moved @ source_from_target


def embed_samples(
    surface: Surface, moved: Float[np.ndarray, "vertices 3"], tilt: float
) -> Float[np.ndarray, "samples 6"]:
    """Give coordinates and weighted normals of the samples of a deformed surface."""
    normals = vertex_normals(moved, surface.faces)
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

"""Functional maps between two surfaces, found without landmarks.

    found = match_surfaces(source, target)
    found.point_map                # source vertex of each target vertex
    found.matrix                   # coefficients on the source to coefficients on the target

Reference: Musoni et al. 2021, section 3.1, which takes the map as given.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.matching.alignment import align_shells, headings
from bunraku.matching.refinement import mapped_coordinates, points_from_map, zoom_out
from bunraku.matching.scoring import surface_stretch, volume_ratio
from bunraku.matching.surfaces import Surface, prepare_surface
from bunraku.spectral import Basis
from bunraku.types import Mesh

__all__ = ["FunctionalMap", "mapped_coordinates", "match_surfaces"]
UP = (0.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class FunctionalMap:
    """A map between two surfaces, and how far to trust it."""

    matrix: Float[np.ndarray, "target_functions source_functions"]
    source_basis: Basis
    target_basis: Basis
    point_map: Int[np.ndarray, " target_vertices"]  # source vertex of each target vertex
    score: float  # 0 is perfect; see scoring.py
    mirrored: bool  # the best map found still turns the surface inside out
    runner_up: float  # score of the next best candidate minus the score


def match_surfaces(
    source: Mesh,
    target: Mesh,
    *,
    modes: int = 100,
    up: tuple[float, float, float] = UP,
    seed: int = 0,
) -> FunctionalMap:
    """Find the functional map between two surfaces, without landmarks."""
    first, second = prepare_surface(source, modes=modes), prepare_surface(target, modes=modes)
    starts = [align_shells(first, second, turn)[0] for turn in headings(np.array(up), 8)]
    scores = [score_map(first, second, matrix) for matrix in starts]
    best, next_best = np.argsort(scores)[:2]
    points = points_from_map(first.basis, second.basis, starts[best])
    matrix, points = zoom_out(
        first.basis, second.basis, points, sizes=[*range(20, modes, 10), modes]
    )
    return FunctionalMap(
        matrix,
        first.basis,
        second.basis,
        points,
        score=scores[best],
        mirrored=volume_ratio(first, second, starts[best]) < 0,
        runner_up=scores[next_best] - scores[best],
    )


def score_map(
    source: Surface, target: Surface, matrix: Float[np.ndarray, "functions functions"]
) -> float:
    """Judge a candidate: 0 is perfect."""
    carried = mapped_coordinates(source.basis, target.basis, matrix, source.vertices)
    return surface_stretch(target, carried)

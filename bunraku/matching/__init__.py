"""Functional maps between two surfaces, found without landmarks.

    found = match_surfaces(source, target)
    found.point_map                # source vertex of each target vertex
    found.matrix                   # coefficients on the source to coefficients on the target

Reference: Musoni et al. 2021, section 3.1, which takes the map as given.
"""

import logging
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from threadpoolctl import threadpool_limits

from bunraku.matching.alignment import SIZES, Alignment, align_shells, fit_map
from bunraku.matching.refinement import mapped_coordinates, points_from_map, zoom_out
from bunraku.matching.scoring import Judgement, judge_alignment
from bunraku.matching.starts import (
    mirror_match,
    start_from_descriptors,
    start_from_falls,
    start_from_headings,
    start_from_signs,
)
from bunraku.matching.surfaces import Surface, prepare_surface, without_faces
from bunraku.spectral import Basis
from bunraku.types import Mesh

__all__ = ["FunctionalMap", "mapped_coordinates", "match_surfaces", "prepare_surface", "zoom_out"]
FEWEST_MODES = SIZES[-1]
LOGGER = logging.getLogger(__name__)
Vector = Float[np.ndarray, "3"]
Ranked = list[tuple[Alignment, Judgement]]


@dataclass(frozen=True, eq=False)
class FunctionalMap:
    """A map between two surfaces, and how far to trust it."""

    matrix: Float[np.ndarray, "target_functions source_functions"]
    source_basis: Basis
    target_basis: Basis
    point_map: Int[np.ndarray, " target_vertices"]  # source vertex of each target vertex
    source_from_target: Float[np.ndarray, "3 3"]  # rotation from which it was found
    origin: str  # the start that won: a heading, a fallen pose, signs, signature
    judgement: Judgement
    score: float  # the judgement's total: 0 is perfect; right .2-.4, doubtful above .4
    mirrored: bool  # left and right are swapped even in the best map found
    runner_up: float  # how much worse the best other map scores; inf: none was left


def match_surfaces(
    source: Mesh,
    target: Mesh,
    *,
    modes: int = 100,
    up: tuple[float, float, float] = (0.0, 1.0, 0.0),
    sure: float = 0.33,
) -> FunctionalMap:
    """Find the functional map between two surfaces without landmarks (Eqs. 1-2).

    Upright figures are tried facing eight ways; if none of them fits surely, lying and upside
    down, and from eigenfunction signs and signatures too. Nothing is random.

    Args:
        source: in its rest pose, standing upright; closed or not, of any size.
        target: in any pose; without faces, a point cloud (then sides may be swapped unseen).
        modes: functions of each basis, and size of the map, 20 or more.
        up: the upward direction of both.
        sure: score below which the first starts are enough.

    Returns:
        the map, refined on all vertices, and the judgement of the candidate it grew from.

    Raises:
        ValueError: if `modes` is below 20, or a mesh has too few vertices for it, or no area.
    """
    if modes < FEWEST_MODES:
        raise ValueError(f"modes must be at least {FEWEST_MODES} to tell limbs apart, got {modes}")
    with threadpool_limits(1):  # the products are small: threads only get in each other's way
        first, second = (prepare_surface(mesh, modes=modes) for mesh in (source, target))
        if not (len(source.faces) and len(target.faces)):
            first, second = without_faces(first), without_faces(second)
        ranked = search_starts(first, second, np.array(up, np.float64), sure=sure)
        best, judgement = ranked[0]
        LOGGER.info("map from %s, score %.3f", best.origin, judgement.total)
        start = fit_map(first, second, best.matched, SIZES[-1])
        points = points_from_map(first.basis, second.basis, start)
        sizes = [*range(SIZES[-1], modes, 10), modes]
        matrix, points = zoom_out(first.basis, second.basis, points, sizes=sizes)
    return FunctionalMap(
        matrix,
        first.basis,
        second.basis,
        points,
        source_from_target=best.source_from_target,
        origin=best.origin,
        judgement=judgement,
        score=judgement.total,
        mirrored=judgement.mirrored,
        runner_up=runner_up_gap(first, ranked),
    )


def search_starts(source: Surface, target: Surface, up: Vector, *, sure: float) -> Ranked:
    """Align from upright headings; unless one fits surely, from every other start as well."""
    ranked = rank_starts(source, target, start_from_headings(source, target, up), up)
    if ranked[0][1].total > sure:
        signed = start_from_signs(source, target, mirror_match(source, up))
        others = [*start_from_falls(source, target, up), *signed]
        others += start_from_descriptors(source, target)
        ranked += rank_starts(source, target, others, up)
    return sorted(ranked, key=lambda entry: entry[1].total)


def rank_starts(
    source: Surface, target: Surface, starts: Iterable[Alignment], up: Vector, *, keep: int = 4
) -> Ranked:
    """Align from every start, first roughly, the best few finely; best first."""
    half = len(SIZES) // 2
    rough = [align_shells(source, target, start, sizes=SIZES[:half]) for start in starts]
    rough.sort(key=lambda alignment: judge_alignment(source, target, alignment, up).total)
    fine = [align_shells(source, target, start, sizes=SIZES[half:]) for start in rough[:keep]]
    ranked = [(entry, judge_alignment(source, target, entry, up)) for entry in fine]
    return sorted(ranked, key=lambda entry: entry[1].total)


def runner_up_gap(source: Surface, ranked: Ranked, *, differ: float = 0.1) -> float:
    """Tell how much worse the best candidate is that sends samples elsewhere (mean, area 1)."""
    places = source.vertices[source.samples]
    best, judgement = ranked[0]
    for other, worse in ranked[1:]:
        if np.linalg.norm(places[best.matched] - places[other.matched], axis=1).mean() > differ:
            return worse.total - judgement.total
    return float("inf")

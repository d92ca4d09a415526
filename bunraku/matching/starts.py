"""Where to start the search for a map: headings, fallen poses, eigenfunction signs, signatures."""

from itertools import product

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from bunraku.matching.alignment import (
    Alignment,
    fit_functions,
    start_from_match,
    start_from_rotation,
)
from bunraku.matching.descriptors import fit_descriptor_map
from bunraku.matching.refinement import nearest_rows
from bunraku.matching.scoring import match_faults, volume_ratio
from bunraku.matching.surfaces import Surface
from bunraku.rotations import rotation_between, vectors_to_matrices

SIGNED = 6  # eigenfunctions whose signs are tried
SIGN_SIZES = (8, 10, 12, 14, 16, 20)
Match = Int[np.ndarray, " target_samples"]


def heading_rotations(up: Float[np.ndarray, "3"], count: int) -> Float[np.ndarray, "count 3 3"]:
    """Give `count` even turns about the upward axis, none first."""
    angles = np.arange(count) * (2 * np.pi / count)
    return vectors_to_matrices(angles[:, None] * up / np.linalg.norm(up))


def fallen_rotations(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "20 3 3"]:
    """Give the quarter turns that do not keep the upward axis: lying and upside down."""
    standard = rotation_between(up, np.array([0.0, 1.0, 0.0]))
    quarters = Rotation.create_group("O").as_matrix()
    fallen = quarters[quarters[:, 1, 1] < 0.5]
    return standard.T @ fallen @ standard


def start_from_headings(
    source: Surface, target: Surface, up: Float[np.ndarray, "3"], *, count: int = 8
) -> list[Alignment]:
    """Stand the target upright beside the source, facing each of several ways."""
    return [
        start_from_rotation(source, target, turn, f"heading {360 * i // count}")
        for i, turn in enumerate(heading_rotations(up, count))
    ]


def start_from_falls(
    source: Surface, target: Surface, up: Float[np.ndarray, "3"]
) -> list[Alignment]:
    """Lay the target down, or turn it upside down, facing each of four ways."""
    return [
        start_from_rotation(source, target, turn, f"fallen {i}")
        for i, turn in enumerate(fallen_rotations(up))
    ]


def start_from_descriptors(source: Surface, target: Surface) -> list[Alignment]:
    """Match wave kernel signatures with a sense of orientation."""
    size = min(30, len(source.basis.values), len(target.basis.values))
    matrix = fit_descriptor_map(source, target, size=size)
    carried = source.basis.functions[source.samples, :size] @ matrix.T
    matched = nearest_rows(carried, target.basis.functions[target.samples, :size])
    return [start_from_match(source, target, matched, "signature")]


def start_from_signs(
    source: Surface,
    target: Surface,
    mirror: Int[np.ndarray, " source_samples"],
    *,
    keep: int = 6,
    samples: int = 150,
) -> list[Alignment]:
    """Try every sign of the first eigenfunctions, and keep the best that differ.

    A candidate that turns the surface inside out is composed with the source's own mirror map.

    Args:
        mirror: the sample opposite to each sample of the source, from `mirror_match`.
        keep: candidates to return.
        samples: of each surface, used while ranking.
    """
    ranked = []
    for signs in product((1.0, -1.0), repeat=SIGNED):
        matrix = grow_signs(source, target, np.diag([1.0, *signs]), samples)
        volume = volume_ratio(source, target, matrix)
        faults = match_faults(source, target, matrix, samples=samples)
        ranked.append((faults - 0.7 * abs(volume), volume, matrix))
    ranked.sort(key=lambda entry: entry[0])
    kept: list[Float[np.ndarray, "functions functions"]] = []
    starts = []
    for _, volume, matrix in ranked:
        if len(kept) < keep and all(np.linalg.norm(matrix - other) > 1 for other in kept):
            kept.append(matrix)
            matched = match_samples(source, target, matrix)
            matched = mirror[matched] if volume < 0 else matched
            starts.append(start_from_match(source, target, matched, "signs"))
    return starts


def grow_signs(
    source: Surface, target: Surface, matrix: Float[np.ndarray, "size size"], samples: int
) -> Float[np.ndarray, "grown grown"]:
    """Grow a small map by ZoomOut on the first samples of both surfaces."""
    own = source.basis.functions[source.samples[:samples]]
    other = target.basis.functions[target.samples[:samples]]
    even = np.full(len(other), 1 / len(other))
    for size in SIGN_SIZES:
        matched = nearest_rows(own[:, : len(matrix)], other[:, : len(matrix)] @ matrix)
        matrix = fit_functions(other[:, :size], even, own[matched, :size], np.zeros(size))
    return matrix


def match_samples(
    source: Surface, target: Surface, matrix: Float[np.ndarray, "size size"]
) -> Match:
    """Read a functional map as a match of all samples."""
    size = len(matrix)
    return nearest_rows(
        source.basis.functions[source.samples, :size],
        target.basis.functions[target.samples, :size] @ matrix,
    )


def mirror_match(
    source: Surface, up: Float[np.ndarray, "3"], *, planes: int = 12
) -> Int[np.ndarray, " source_samples"]:
    """Find the sample opposite to each of the source's, in its best upright mirror plane.

    The plane goes through the centre; of several headings the one whose mirror image lies
    nearest to the source itself is taken, so the source must stand in a symmetric pose.
    """
    points = source.vertices[source.samples]
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    normals = heading_rotations(up, 2 * planes)[:planes] @ (side / np.linalg.norm(side))
    tree = KDTree(points)
    matches = [tree.query(points - 2 * np.outer(points @ n, n)) for n in normals]
    return min(matches, key=lambda match: float(source.areas @ match[0]))[1]

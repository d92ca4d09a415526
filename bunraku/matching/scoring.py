"""Judges of a map. No single one knows a right map, so several are added, and all are kept.

Left and right swapped turns a surface inside out (`inside_out`, `improper`). Front and back
swapped as well does not: then noses, toes and bending limbs end up on the wrong side, which only
geometry shows. The source, deformed to lie on the target, must meet it with its normals
(`distance`), and where the functional map says (`disagreement`); the map must keep areas (`skew`).
Weights of the sum: on 38 pairs of posed bodies with 384 candidates they lost least to the best
candidate; distance alone lost little more, volume and reflections alone lost most.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from bunraku.matching.alignment import Alignment, fit_map
from bunraku.matching.refinement import mapped_coordinates, nearest_rows
from bunraku.matching.surfaces import Surface
from bunraku.meshes import signed_volume, vertex_normals
from bunraku.rotations import nearest_rotation, rotation_angles


@dataclass(frozen=True)
class Judgement:
    """What speaks against an alignment; every entry is 0 for a perfect one."""

    distance: float  # between deformed source and target, both ways, normals included
    disagreement: float  # between the functional map's match and the places of its samples
    skew: float  # how far the functional map is from orthogonal
    bending: float  # mean angle between the rotations of neighbouring regions, radians
    improper: float  # share of the area of regions turned into their mirror image
    inside_out: float  # 1 - volume carried by the functional map, as a share of the source's
    fallen: float  # 1 - mean cosine between up on the source and up carried to the target

    @property
    def total(self) -> float:
        """Give one number to compare alignments by: the best single judges by their spread."""
        return (self.distance + 2.0 * self.disagreement + 0.5 * self.skew) / 3.0

    @property
    def mirrored(self) -> bool:
        """Tell whether left and right are swapped."""
        return self.inside_out > 1.0


def judge_alignment(
    source: Surface, target: Surface, alignment: Alignment, up: Float[np.ndarray, "3"]
) -> Judgement:
    """Measure what speaks against an alignment."""
    turn = alignment.source_from_target
    moved = alignment.moved @ turn
    rotations, bending, improper = region_rotations(source, moved)
    carried = rotations @ (up / np.linalg.norm(up))
    matrix = fit_map(source, target, alignment.matched, alignment.size)
    size = alignment.size
    gaps = moved[source.samples[alignment.matched]] - target.vertices[target.samples]
    return Judgement(
        distance=mutual_distance(source, target, moved),
        disagreement=float(target.areas @ soft_distance((gaps**2).sum(axis=1))),
        skew=float(np.linalg.norm(matrix.T @ matrix - np.eye(size)) / np.sqrt(size)),
        bending=bending,
        improper=improper,
        inside_out=1.0 - volume_ratio(source, target, matrix),
        fallen=1.0 - float((carried @ (up / np.linalg.norm(up))).mean()),
    )


def mutual_distance(
    source: Surface,
    target: Surface,
    moved: Float[np.ndarray, "source_vertices 3"],
    *,
    tilt: float = 0.1,
) -> float:
    """Measure how far the deformed source and the target are from each other, 0 to 2.

    Adds over both surfaces the soft distance, in place and weighted normal, of each sample to the
    nearest vertex of the other.
    """
    places = np.hstack([moved, tilt * vertex_normals(moved, source.faces)])
    goals = np.hstack([target.vertices, tilt * target.normals])
    there = KDTree(goals).query(places[source.samples])[0] ** 2
    back = KDTree(places).query(goals[target.samples])[0] ** 2
    return float(source.areas @ soft_distance(there) + target.areas @ soft_distance(back))


def soft_distance(
    squared: Float[np.ndarray, " samples"], *, tolerance: float = 0.05
) -> Float[np.ndarray, " samples"]:
    """Turn squared distances (area 1) into 0 near to 1 far, d^2 / (d^2 + tolerance^2)."""
    return squared / (squared + tolerance**2)


def region_rotations(
    source: Surface, moved: Float[np.ndarray, "source_vertices 3"], *, count: int = 64
) -> tuple[Float[np.ndarray, "regions 3 3"], float, float]:
    """Fit a rotation to each region of the deformed source (Procrustes).

    Returns:
        the rotations, the mean angle between neighbours, and the share of the area of regions
        that a reflection would fit better.
    """
    centres = source.vertices[source.samples[:count]]
    region = KDTree(centres).query(source.vertices)[1]
    areas = np.maximum(np.bincount(region, source.basis.mass, count), 1e-12)
    offsets = []
    for points in (moved, source.vertices):
        weighted = source.basis.mass[:, None] * points
        sums = [np.bincount(region, column, count) for column in weighted.T]
        offsets.append(points - (np.stack(sums, axis=1) / areas[:, None])[region])
    outer = np.einsum("v,va,vb->vab", source.basis.mass, *offsets).reshape(-1, 9)
    covariances = np.stack([np.bincount(region, entry, count) for entry in outer.T], axis=1)
    covariances = covariances.reshape(-1, 3, 3)
    rotations = nearest_rotation(covariances)
    ends = region[source.faces]
    pairs = np.unique(ends.ravel() * count + np.roll(ends, 1, axis=1).ravel())
    first, second = np.divmod(pairs[pairs // count < pairs % count], count)
    between = np.swapaxes(rotations[first], -1, -2) @ rotations[second]
    bending = float(rotation_angles(between).mean()) if len(first) else 0.0
    return rotations, bending, float(areas @ (np.linalg.det(covariances) < 0))


def volume_ratio(
    source: Surface, target: Surface, matrix: Float[np.ndarray, "functions functions"]
) -> float:
    """Compare the signed volume of the carried target with the source's, both low-pass.

    Near 1 if the map is right, below 0 if it swaps left and right. 1 for point clouds.
    """
    if not (len(source.faces) and len(target.faces)):
        return 1.0
    carried = mapped_coordinates(source.basis, target.basis, matrix, source.vertices)
    same = np.eye(matrix.shape[1])
    smooth = mapped_coordinates(source.basis, source.basis, same, source.vertices)
    return signed_volume(carried, target.faces) / signed_volume(smooth, source.faces)


def match_faults(
    source: Surface,
    target: Surface,
    matrix: Float[np.ndarray, "size size"],
    *,
    samples: int = 600,
) -> float:
    """Add up orthogonality error, four times the cycle error, and the share of samples not hit.

    True maps of bodies score .4 to .6, wrong ones .9 and more, with many exceptions.
    """
    size = len(matrix)
    own = source.basis.functions[source.samples[:samples], :size]
    carried = target.basis.functions[target.samples[:samples], :size] @ matrix
    matched, back = nearest_rows(own, carried), nearest_rows(carried, own)
    places = target.vertices[target.samples[:samples]]
    cycle = np.linalg.norm(places - places[back[matched]], axis=1).mean()
    skew = np.linalg.norm(matrix.T @ matrix - np.eye(size)) / np.sqrt(size)
    return float(skew + 4 * cycle + 1 - len(np.unique(matched)) / len(matched))

"""Symmetric closest points between a moving surface and a still one, in position and normal."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from bunraku.meshes import farthest_points, vertex_areas, vertex_normals


@dataclass(frozen=True, eq=False)
class Pairs:
    """Points of the moving surface and where the still one wants them."""

    moving: Int[np.ndarray, " pairs"]  # vertex of the moving surface
    still: Int[np.ndarray, " pairs"]  # vertex of the still one
    squared: Float[np.ndarray, " pairs"]  # distance squared, normals included
    weight: Float[np.ndarray, " pairs"]  # beside the robust weight


@dataclass(frozen=True, eq=False)
class Surface:
    """A still surface to fit to: vertices with unit normals, and an even sample of them."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]
    normals: Float[np.ndarray, "vertices 3"]
    areas: Float[np.ndarray, " vertices"]
    samples: Int[np.ndarray, " samples"]  # farthest first
    pins: Pairs  # held whatever the distance

    @cached_property
    def _trees(self) -> dict[tuple[float, int], cKDTree]:
        return {}

    def tree(self, normal_weight: float, count: int) -> cKDTree:
        """Give the search tree over the first `count` samples, built when first asked for."""
        key = normal_weight, count
        if key not in self._trees:
            chosen = self.samples[:count]
            points = features(self.vertices[chosen], self.normals[chosen], normal_weight)
            self._trees[key] = cKDTree(points)
        return self._trees[key]


def make_surface(
    vertices: Float[np.ndarray, "vertices 3"], faces: Int[np.ndarray, "faces 3"]
) -> Surface:
    """Prepare a surface for fitting."""
    normals, areas = vertex_normals(vertices, faces), vertex_areas(vertices, faces)
    none = np.empty(0, np.int64)
    samples = farthest_points(vertices, 2500)
    return Surface(vertices, faces, normals, areas, samples, pin(none, none, 1.0))


def features(
    points: Float[np.ndarray, "points 3"], normals: Float[np.ndarray, "points 3"], weight: float
) -> Float[np.ndarray, "points 6"]:
    """Put position and weighted normal side by side."""
    return np.hstack([points, weight * normals])


def find_pairs(
    moved: tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3"]],
    samples: Int[np.ndarray, " samples"],
    surface: Surface,
    *,
    normal_weight: float,
    queries: int,
) -> Pairs:
    """Pair both ways: the first `queries` samples of each side with the nearest of the other.

    Args:
        moved: positions and normals of the moving surface's samples.
        samples: their vertex numbers, farthest first.
        surface: the still surface.
        normal_weight: metres that a whole unit of normal counts for.
        queries: how many samples of each side ask.
    """
    moving = features(*moved, normal_weight)
    tree = surface.tree(normal_weight, len(samples))
    forward, nearest = tree.query(moving[:queries])
    backward, asked = cKDTree(moving).query(tree.data[:queries])
    return Pairs(
        np.concatenate([samples[:queries], samples[asked]]),
        np.concatenate([surface.samples[nearest], surface.samples[:queries]]),
        np.concatenate([forward, backward]) ** 2,
        np.ones(len(forward) + len(backward)),
    )


def pin(moving: Int[np.ndarray, " pins"], still: Int[np.ndarray, " pins"], weight: float) -> Pairs:
    """Hold vertices of the moving surface to vertices of the still one, however far."""
    return Pairs(moving, still, np.zeros(len(moving)), np.full(len(moving), weight))


def join_pairs(pairs: Pairs, pins: Pairs) -> Pairs:
    """Put two sets of pairs together."""
    both = zip(vars(pairs).values(), vars(pins).values(), strict=True)
    return Pairs(*(np.concatenate(columns) for columns in both))


def robust_weights(
    squared: Float[np.ndarray, " pairs"], width: float
) -> Float[np.ndarray, " pairs"]:
    """Weigh pairs by (1 + d^2 / width^2)^-2 (Geman-McClure)."""
    return (1.0 + squared / width**2) ** -2


def misfit(
    moved: tuple[Float[np.ndarray, "samples 3"], Float[np.ndarray, "samples 3"]],
    samples: Int[np.ndarray, " samples"],
    surface: Surface,
    *,
    width: float = 0.1,
) -> float:
    """Judge a fit: mean of d^2 / (d^2 + width^2), both ways added; 0 perfect, 2 nowhere near."""
    pairs = find_pairs(moved, samples, surface, normal_weight=0.1, queries=len(samples))
    return 2.0 * float(np.mean(pairs.squared / (pairs.squared + width**2)))

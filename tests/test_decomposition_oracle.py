"""Skinning decomposition against Dem Bones (Le and Deng's own solver), where it is installed."""

import numpy as np
import pytest

from bunraku.bones.decomposition import blend, decompose
from bunraku.rotations import vectors_to_matrices

oracle = pytest.importorskip("py_dem_bones", reason="needs py-dem-bones, a test's oracle")


def test_ours_explains_a_blended_bend_as_well_as_dem_bones():
    """A tube whose middle blends two bones smoothly; both solvers may have two bones."""
    rings, sides = 41, 16
    along = np.repeat(np.linspace(0, 2, rings), sides)
    around = np.tile(np.arange(sides) * 2 * np.pi / sides, rings)
    rest = np.column_stack([along, 0.2 * np.cos(around), 0.2 * np.sin(around)])
    share = np.clip((along - 0.8) / 0.4, 0, 1)[:, None]
    turns = vectors_to_matrices(np.linspace(0, 1.2, 8)[:, None] * [0.0, 0.0, 1.0])
    middle = np.array([1.0, 0.0, 0.0])
    bent = np.einsum("fab,vb->fva", turns, rest - middle) + middle
    paths = (1 - share) * rest + share * bent

    weights, rotations, shifts = decompose(
        rest, paths, (along > 1).astype(np.int64), np.array([-1, 0])
    )
    affine = np.concatenate([rotations, shifts[..., None]], axis=-1)
    ours = play(weights, affine, rest)
    corner = np.arange((rings - 1) * sides)
    beside = corner - corner % sides + (corner + 1) % sides
    faces = np.column_stack([corner, beside, corner + sides])
    found = oracle.solve_skinning(rest, paths, 2, faces=faces)
    theirs = play(found.weights.T, found.transforms[:, :, :3], rest)
    error, other = (np.sqrt(((got - paths) ** 2).sum(-1).mean()) for got in (ours, theirs))
    assert error < 1e-3
    assert error <= 1.1 * other + 1e-4


def play(weights, affine, rest):
    points = np.column_stack([rest, np.ones(len(rest))])
    return np.einsum("fvac,vc->fva", blend(weights, affine), points)

import numpy as np
import pytest
import trimesh

from bunraku.matching import mapped_coordinates
from bunraku.spectral import eigenbasis
from bunraku.weights import (
    transfer_by_function,
    transfer_by_points,
    transfer_nearest,
    transfer_to_surface,
)

TRIANGLE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), np.array([[0, 1, 2]])


@pytest.fixture
def source_weights(rng):
    return rng.dirichlet(np.ones(4), size=8)


def test_nearest_copies_and_surface_blends():
    """One triangle, one point a quarter of the way along an edge: by hand."""
    vertices, faces = TRIANGLE
    carried = np.array([[0.25, 0.0, 0.3]])
    np.testing.assert_allclose(transfer_nearest(np.eye(3), vertices, carried), [[1, 0, 0]])
    blended = transfer_to_surface(np.eye(3), vertices, faces, carried)
    np.testing.assert_allclose(blended, [[0.75, 0.25, 0.0]])


def test_points_copy_rows(source_weights):
    copied = transfer_by_points(source_weights, np.array([7, 0, 0]))
    np.testing.assert_array_equal(copied, source_weights[[7, 0, 0]])


def test_nearest_agrees_with_the_minimum_written_out(source_weights, rng):
    vertices, carried = rng.normal(size=(8, 3)), rng.normal(size=(20, 3))
    nearest = [min(range(8), key=lambda k: np.linalg.norm(x - vertices[k])) for x in carried]
    np.testing.assert_array_equal(
        transfer_nearest(source_weights, vertices, carried), source_weights[nearest]
    )


def test_the_identity_map_of_a_smooth_surface_moves_no_weight():
    sphere = trimesh.creation.icosphere(subdivisions=3)
    vertices, faces = np.array(sphere.vertices), np.array(sphere.faces)
    basis = eigenbasis(vertices, faces, count=16)
    weights = np.column_stack([vertices[:, 0] + 1, 1 - vertices[:, 0]]) / 2
    carried = mapped_coordinates(basis, basis, np.eye(16), vertices)
    blended = transfer_to_surface(weights, vertices, faces, carried)
    np.testing.assert_allclose(blended, weights, atol=1e-3)
    np.testing.assert_allclose(transfer_nearest(weights, vertices, carried), weights)
    mapped = transfer_by_function(weights, basis, basis, np.eye(16))
    np.testing.assert_allclose(mapped, weights, atol=1e-3)


def test_function_transfer_is_the_product_in_the_paper(cube, source_weights, rng):
    basis = eigenbasis(cube.vertices, cube.faces, count=6)
    matrix = rng.normal(size=(4, 5))
    inverse = basis.functions[:, :5].T @ np.diag(basis.mass)
    np.testing.assert_allclose(
        transfer_by_function(source_weights, basis, basis, matrix),
        basis.functions[:, :4] @ matrix @ inverse @ source_weights,
    )


def test_weights_stay_a_partition_of_one(cube, source_weights, rng):
    carried = rng.normal(size=(30, 3))
    for moved in (
        transfer_nearest(source_weights, cube.vertices, carried),
        transfer_to_surface(source_weights, cube.vertices, cube.faces, carried),
    ):
        np.testing.assert_allclose(moved.sum(axis=1), 1.0)
        assert (moved >= 0).all()

import logging

import numpy as np
import pytest
import trimesh
from scipy.linalg import eigh
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

from bunraku.spectral import (
    Basis,
    eigenbasis,
    factorise,
    heat_kernel_signature,
    improve_functions,
    laplacian,
    project,
    prolonged_functions,
    wave_kernel_signature,
)


def sphere(subdivisions=3):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return np.array(mesh.vertices), np.array(mesh.faces, np.int64)


def blob(rng, subdivisions=3):
    """A sphere with bumps, so that no two eigenvalues are equal."""
    vertices, faces = sphere(subdivisions)
    centres = rng.normal(size=(6, 3))
    bumps = np.exp(-4 * ((vertices[:, None] - centres) ** 2).sum(axis=2)).sum(axis=1)
    return vertices * (1 + 0.5 * bumps[:, None]) * [1.0, 1.3, 1.7], faces


def test_the_laplacian_of_one_right_triangle():
    """Cotangents of a 3-4-5 triangle by hand: edges at angle a weigh cot(a) / 2."""
    vertices = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    stiffness, mass = laplacian(vertices, np.array([[0, 1, 2]]))
    long, short = (3 / 4) / 2, (4 / 3) / 2  # half the cotangents at the corners (0, 3) and (4, 0)
    expected = [[long + short, -long, -short], [-long, long, 0], [-short, 0, short]]
    np.testing.assert_allclose(stiffness.toarray(), expected, atol=1e-4)
    np.testing.assert_allclose(mass, 2.0, rtol=1e-4)


def test_a_sphere_of_area_one_has_the_values_of_spherical_harmonics():
    basis = eigenbasis(*sphere(4), count=16)
    degrees = np.repeat([0, 1, 2, 3], [1, 3, 5, 7])
    np.testing.assert_allclose(
        basis.values, 4 * np.pi * degrees * (degrees + 1), rtol=6e-3, atol=1e-9
    )


def test_functions_are_orthonormal_and_solve_the_equation(rng):
    vertices, faces = blob(rng)
    basis = eigenbasis(vertices, faces, count=30)
    gram = basis.functions.T @ (basis.mass[:, None] * basis.functions)
    np.testing.assert_allclose(gram, np.eye(30), atol=1e-9)
    stiffness, _ = laplacian(vertices, faces)
    left, right = stiffness @ basis.functions, basis.mass[:, None] * basis.functions * basis.values
    np.testing.assert_allclose(left, right, atol=1e-7)
    assert basis.mass.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(basis.functions[:, 0], 1.0)


def test_agrees_with_a_dense_solver(rng):
    vertices, faces = blob(rng, 2)
    stiffness, mass = laplacian(vertices, faces)
    values = eigh(stiffness.toarray(), np.diag(mass / mass.sum()), eigvals_only=True)
    np.testing.assert_allclose(
        eigenbasis(vertices, faces, count=20).values, np.maximum(values[:20], 0), atol=1e-8
    )


def test_size_and_place_do_not_matter_and_calls_agree(rng):
    vertices, faces = blob(rng)
    basis = eigenbasis(vertices, faces, count=20)
    moved = eigenbasis(100 * vertices @ Rotation.random(rng=rng).as_matrix().T + 7, faces, count=20)
    np.testing.assert_allclose(moved.values, basis.values, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(moved.functions, basis.functions, atol=1e-5)
    again = eigenbasis(vertices, faces, count=20)
    np.testing.assert_array_equal(again.functions, basis.functions)
    peaks = np.take_along_axis(
        basis.functions, np.abs(basis.functions).argmax(axis=0)[None], axis=0
    )
    assert (peaks > 0).all()


def test_the_coarse_way_agrees_with_the_exact_one(rng):
    """Ritz values lie above the true ones; the stated error is the bound."""
    vertices, faces = blob(rng, 4)
    exact = eigenbasis(vertices, faces, count=50)
    stiffness, mass = laplacian(vertices, faces)
    guess = prolonged_functions(vertices, faces, 60, coarse_count=900)
    values, functions = improve_functions(stiffness, mass / mass.sum(), guess)
    relative = values[1:50] / exact.values[1:] - 1
    assert relative.min() > -1e-9
    assert relative.max() < 6e-3
    overlap = functions[:, :30].T @ (exact.mass[:, None] * exact.functions)
    assert np.linalg.svd(overlap, compute_uv=False).min() > 0.9999


def test_large_meshes_take_the_coarse_way(rng):
    vertices, faces = blob(rng, 4)
    exact, coarse = (
        eigenbasis(vertices, faces, count=20, exact_below=limit) for limit in (10_000, 1000)
    )
    assert not np.array_equal(coarse.values, exact.values)
    np.testing.assert_allclose(coarse.values, exact.values, rtol=1e-3, atol=1e-6)
    gram = coarse.functions.T @ (coarse.mass[:, None] * coarse.functions)
    np.testing.assert_allclose(gram, np.eye(20), atol=1e-9)


def test_points_without_faces_have_a_basis(rng):
    vertices, faces = sphere(4)
    cloud = eigenbasis(vertices, np.zeros((0, 3), np.int64), count=9)
    np.testing.assert_allclose(
        cloud.values, eigenbasis(vertices, faces, count=9).values, rtol=0.05, atol=1e-6
    )


def test_vertices_without_faces_get_zeros(rng):
    vertices, faces = blob(rng)
    loose = eigenbasis(np.vstack([vertices, [[9.0, 9.0, 9.0]]]), faces, count=10)
    np.testing.assert_array_equal(loose.functions[-1], 0.0)
    np.testing.assert_allclose(loose.values, eigenbasis(vertices, faces, count=10).values)


def test_two_parts_have_two_constant_functions(rng):
    vertices, faces = blob(rng)
    both = np.vstack([vertices, vertices + 5]), np.vstack([faces, faces + len(vertices)])
    values = eigenbasis(*both, count=5).values
    np.testing.assert_allclose(values[:2], 0.0, atol=1e-8)
    assert values[2] > 1.0


def test_projection_inverts_the_basis(rng):
    basis = eigenbasis(*blob(rng), count=12)
    coefficients = rng.normal(size=(12, 3))
    np.testing.assert_allclose(project(basis, basis.functions @ coefficients), coefficients)
    alone = project(basis, basis.functions @ coefficients[:, 0])
    np.testing.assert_allclose(alone, coefficients[:, 0])


def test_heat_signature_of_two_functions_by_hand():
    basis = Basis(np.array([0.0, 2.0]), np.array([[1.0, 1.0], [1.0, -1.0]]), np.array([0.5, 0.5]))
    np.testing.assert_allclose(heat_kernel_signature(basis, np.array([0.3])), 1.0)
    uneven = Basis(basis.values, np.array([[1.0, 2.0], [1.0, 0.0]]), basis.mass)
    decay = np.exp(-0.6)
    np.testing.assert_allclose(
        heat_kernel_signature(uneven, np.array([0.3])),
        [[(1 + 4 * decay) / (1 + decay)], [1 / (1 + decay)]],
    )


def test_signatures_average_to_one_and_ignore_pose(rng):
    vertices, faces = blob(rng)
    turned = vertices @ Rotation.random(rng=rng).as_matrix().T
    first, second = (eigenbasis(points, faces, count=40) for points in (vertices, turned))
    times = np.array([0.01, 0.1])
    for signature in (
        lambda basis: heat_kernel_signature(basis, times),
        lambda basis: wave_kernel_signature(basis, 20),
    ):
        np.testing.assert_allclose(first.mass @ signature(first), 1.0)
        np.testing.assert_allclose(signature(first), signature(second), atol=1e-5)


def test_wave_signature_agrees_with_its_sum(rng):
    basis = eigenbasis(*blob(rng, 2), count=8)
    logs = np.log(basis.values[1:])
    scale = np.linspace(logs[0], logs[-1] / 1.02, 5)
    width = 7 * (scale[1] - scale[0])
    bands = [[np.exp(-((e - log) ** 2) / (2 * width**2)) for log in logs] for e in scale]
    expected = [
        [sum(b * f**2 for b, f in zip(band, row[1:], strict=True)) / sum(band) for band in bands]
        for row in basis.functions[:10]
    ]
    np.testing.assert_allclose(wave_kernel_signature(basis, 5)[:10], expected)


def test_a_singular_matrix_gets_a_larger_shift(caplog):
    stiffness = csc_matrix(np.array([[-1e-2, 0.0], [0.0, 1.0]]))
    with caplog.at_level(logging.INFO):
        _, shift = factorise(stiffness, np.ones(2))
    assert shift == 1.0
    assert "singular at shift 0.01" in caplog.text


def test_a_matrix_that_stays_singular_is_refused():
    with pytest.raises(ValueError, match="the Laplacian is singular"):
        factorise(csc_matrix((2, 2)), np.zeros(2))


def test_too_few_vertices_are_refused(cube):
    with pytest.raises(ValueError, match="9 eigenfunctions need more than 9 vertices"):
        eigenbasis(cube.vertices, cube.faces, count=9)


@pytest.mark.usefixtures("as_user")
def test_a_basis_needs_one_row_per_mass():
    with pytest.raises(ValueError, match=r"functions must have shape \(3, 2\)"):
        Basis(np.zeros(2), np.zeros((4, 2)), np.zeros(3))

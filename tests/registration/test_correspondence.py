import weakref
from dataclasses import replace

import numpy as np
import pytest

from bunraku.meshes import vertex_normals
from bunraku.registration.correspondence import (
    features,
    find_pairs,
    make_surface,
    misfit,
    robust_weights,
)

UP = np.array([0.0, 0, 1])


@pytest.fixture
def cube_surface(cube):
    return make_surface(cube.vertices, cube.faces)


def test_robust_weights_by_hand():
    weights = robust_weights(np.array([0.0, 0.25, 1.0]), 0.5)
    np.testing.assert_allclose(weights, [1, 1 / 4, 1 / 25])


def test_features_put_the_weighted_normal_beside_the_place():
    np.testing.assert_allclose(
        features(np.array([[1.0, 2, 3]]), UP[None], 0.1), [[1, 2, 3, 0, 0, 0.1]]
    )


def test_a_surface_knows_its_normals_areas_and_samples(cube, cube_surface):
    np.testing.assert_allclose(
        cube_surface.normals, vertex_normals(cube.vertices, cube.faces), atol=1e-12
    )
    assert np.isclose(cube_surface.areas.sum(), 6.0)
    assert sorted(cube_surface.samples) == list(range(8))


def test_a_surface_that_has_not_moved_meets_itself(creature):
    surface = make_surface(creature.mesh.vertices, creature.mesh.faces)
    samples = surface.samples
    moved = surface.vertices[samples], surface.normals[samples]
    pairs = find_pairs(moved, samples, surface, normal_weight=0.1, queries=200)
    np.testing.assert_array_equal(pairs.moving, pairs.still)
    np.testing.assert_allclose(pairs.squared, 0, atol=1e-20)
    assert len(pairs.moving) == 400
    assert np.isclose(misfit(moved, samples, surface), 0)


def test_pairs_agree_with_all_distances(cube_surface, rng):
    """Both ways, over positions and normals, against every pair measured."""
    samples = rng.permutation(6)
    moved = rng.uniform(0, 1, (6, 3)), rng.normal(size=(6, 3))
    pairs = find_pairs(moved, samples, cube_surface, normal_weight=0.3, queries=4)
    chosen = cube_surface.samples[:6]
    between = (
        np.linalg.norm(moved[0][:, None] - cube_surface.vertices[chosen][None], axis=2) ** 2
        + 0.3**2
        * np.linalg.norm(moved[1][:, None] - cube_surface.normals[chosen][None], axis=2) ** 2
    )
    forward, backward = between[:4], between[:, :4]
    np.testing.assert_array_equal(pairs.moving[:4], samples[:4])
    np.testing.assert_array_equal(pairs.still[:4], chosen[forward.argmin(axis=1)])
    np.testing.assert_array_equal(pairs.moving[4:], samples[backward.argmin(axis=0)])
    np.testing.assert_array_equal(pairs.still[4:], chosen[:4])
    expected = np.concatenate([forward.min(axis=1), backward.min(axis=0)])
    np.testing.assert_allclose(pairs.squared, expected)


def test_normals_keep_two_sides_of_a_thin_sheet_apart():
    """A point just over the lower side belongs to the side that faces its way."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    sheet = make_surface(np.vstack([corners, corners + 0.1 * UP]), np.array([[0, 2, 1], [3, 4, 5]]))
    moved = np.array([[0.0, 0, 0.01]]), UP[None]
    for weight, height in ((0.0, 0.0), (0.5, 0.1)):
        tree = sheet.tree(weight, 6)
        _, nearest = tree.query(features(*moved, weight))
        assert sheet.vertices[sheet.samples[nearest[0]], 2] == height


def test_a_tree_is_built_once_and_goes_with_its_surface(cube):
    surface = make_surface(cube.vertices, cube.faces)
    tree = surface.tree(0.1, 4)
    assert tree is surface.tree(0.1, 4) and tree.n == 4
    assert surface.tree(0.1, 5).n == 5 and not np.array_equal(surface.tree(0.2, 4).data, tree.data)
    moved = replace(surface, vertices=surface.vertices + 1.0)
    np.testing.assert_allclose(moved.tree(0.1, 4).data[:, :3], tree.data[:, :3] + 1.0)
    gone = weakref.ref(surface)
    del surface
    assert gone() is None


def test_misfit_grows_with_the_distance_up_to_two(creature):
    surface = make_surface(creature.mesh.vertices, creature.mesh.faces)
    samples = surface.samples[:300]
    errors = [
        misfit(
            (surface.vertices[samples] + [distance, 0, 0], surface.normals[samples]),
            samples,
            surface,
        )
        for distance in (0.0, 0.02, 0.1, 0.5, 100.0)
    ]
    assert (np.diff(errors) > 0).all() and 1.99 < errors[-1] <= 2.0

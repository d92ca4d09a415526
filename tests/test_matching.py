import logging
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from bunraku.matching import mapped_coordinates, match_surfaces
from bunraku.matching.alignment import (
    align_shells,
    deform_towards,
    fit_map,
    start_from_match,
    start_from_rotation,
)
from bunraku.matching.descriptors import (
    commutation,
    fit_descriptor_map,
    multiplications,
    orientations,
)
from bunraku.matching.refinement import (
    map_from_points,
    nearest_rows,
    points_from_fitted_map,
    points_from_map,
    zoom_out,
)
from bunraku.matching.scoring import (
    judge_alignment,
    match_faults,
    mutual_distance,
    region_rotations,
    volume_ratio,
)
from bunraku.matching.starts import (
    fallen_rotations,
    heading_rotations,
    mirror_match,
    start_from_descriptors,
    start_from_signs,
)
from bunraku.matching.surfaces import prepare_surface
from bunraku.spectral import Basis, project
from bunraku.types import Mesh
from tests.creatures import make_creature, move, pose_of, world_pose

UP = np.array([0.0, 1.0, 0.0])
POSE = {
    "hips": (0, 110, 0),
    "leftArm": (0, 20, 40),
    "rightArm": (0, 35, 0),
    "leftLeg": (-30, 0, 0),
    "head": (10, 25, 0),
}


@pytest.fixture(scope="module")
def source_mesh():
    return make_creature(0.035).mesh


@pytest.fixture(scope="module")
def target_character():
    """The creature with other triangles; its rest surface is where each vertex belongs."""
    return make_creature(0.037)


@pytest.fixture(scope="module")
def target_mesh(target_character):
    """It faces sideways, lifts its arms and a leg, and is twice as large."""
    world = world_pose(target_character.skeleton, pose_of(POSE))
    return Mesh(2 * move(target_character, world), target_character.mesh.faces)


@pytest.fixture(scope="module")
def source(source_mesh):
    return prepare_surface(source_mesh, modes=40, samples=300)


@pytest.fixture(scope="module")
def target(target_mesh):
    return prepare_surface(target_mesh, modes=40, samples=300)


@pytest.fixture(scope="module")
def truth(source_mesh, target_character):
    """Nearest source vertex of each target vertex, both at rest."""
    return nearest_rows(source_mesh.vertices, target_character.mesh.vertices)


def place_error(source_mesh, target_character, point_map):
    """Mean distance on the source between found and true places, as a share of its height."""
    places = source_mesh.vertices[point_map] - target_character.mesh.vertices
    return np.linalg.norm(places, axis=1).mean() / np.ptp(source_mesh.vertices[:, 1])


def test_nearest_rows_by_hand_and_in_blocks(rng):
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 2.0]])
    queries = np.array([[0.9, 0.2], [0.1, 1.5], [-3.0, -3.0]])
    np.testing.assert_array_equal(nearest_rows(points, queries), [1, 2, 0])
    points, queries = rng.normal(size=(50, 7)), rng.normal(size=(2500, 7))
    plain = ((queries[:, None] - points) ** 2).sum(axis=2).argmin(axis=1)
    np.testing.assert_array_equal(nearest_rows(points, queries), plain)


def test_the_identity_has_the_identity_as_its_map(source):
    everything = np.arange(len(source.vertices))
    matrix = map_from_points(source.basis, source.basis, everything, size=30)
    np.testing.assert_allclose(matrix, np.eye(30), atol=1e-9)
    for read in (points_from_map, points_from_fitted_map):
        found = read(source.basis, source.basis, matrix)
        assert (found != everything).mean() < 0.01  # slivers collapse in single precision


def test_a_map_sends_functions_as_its_points_do(source, target, truth):
    """Eq. 2: C a is the projection of a function pulled back through the point map."""
    matrix = map_from_points(source.basis, target.basis, truth, size=20)
    coefficients = np.linspace(1, -1, 20)
    function = source.basis.functions[:, :20] @ coefficients
    expected = project(target.basis.first(20), function[truth])
    np.testing.assert_allclose(matrix @ coefficients, expected)


def test_a_fitted_map_is_read_on_its_accurate_side(source):
    """A map that exaggerates its last functions still matches in the target's functions."""
    uneven = np.diag(np.r_[np.ones(20), np.full(10, 3.0)])
    exact = np.arange(len(source.vertices))
    stretched = Basis(
        source.basis.values[:30], source.basis.functions[:, :30] @ uneven, source.basis.mass
    )
    fitted = points_from_fitted_map(source.basis, stretched, uneven)
    assert (fitted != exact).mean() < 0.01
    assert (points_from_map(source.basis, stretched, uneven) != exact).mean() > 0.1


def test_zoom_out_sharpens_a_blurred_map(source, target, truth, source_mesh, target_character):
    blurred = map_from_points(source.basis, target.basis, truth, size=8)
    points = points_from_map(source.basis, target.basis, blurred)
    matrix, sharp = zoom_out(source.basis, target.basis, points, sizes=[10, 20, 30, 40])
    errors = [place_error(source_mesh, target_character, found) for found in (points, sharp)]
    assert errors[1] < 0.03 < errors[0]
    assert matrix.shape == (40, 40)


def test_mapped_coordinates_follow_the_equations(source, target, rng):
    matrix = rng.normal(size=(15, 12))
    inverse = source.basis.functions[:, :12].T @ np.diag(source.basis.mass)
    expected = target.basis.functions[:, :15] @ matrix @ inverse @ source.vertices
    np.testing.assert_allclose(
        mapped_coordinates(source.basis, target.basis, matrix, source.vertices), expected
    )


def test_surfaces_are_scaled_to_area_one(target, target_mesh):
    scaled = Mesh(target.vertices, target.faces)
    assert trimesh.Trimesh(scaled.vertices, scaled.faces).area == pytest.approx(1.0)
    np.testing.assert_allclose(target.basis.mass @ target.vertices, 0.0, atol=1e-12)
    assert target.areas.sum() == pytest.approx(1.0)
    assert len(np.unique(target.samples)) == 300


def test_headings_turn_about_up_and_falls_do_not():
    turns, falls = heading_rotations(UP, 8), fallen_rotations(UP)
    np.testing.assert_allclose(turns @ UP, np.tile(UP, (8, 1)), atol=1e-12)
    np.testing.assert_allclose(turns[2] @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    assert len(falls) == 20
    assert (falls @ UP @ UP < 0.5).all()
    np.testing.assert_allclose(np.linalg.det(falls), 1.0)
    sideways = np.array([0.0, 0.0, 2.0])
    np.testing.assert_allclose(heading_rotations(sideways, 4) @ sideways, [sideways] * 4)
    assert (fallen_rotations(sideways / 2)[:, 2, 2] < 0.5).all()


def test_a_copy_turned_to_the_start_aligns_exactly(source):
    start = start_from_rotation(source, source, np.eye(3), "same")
    np.testing.assert_array_equal(start.matched, np.arange(300))
    done = align_shells(source, source, start)
    np.testing.assert_array_equal(done.matched, np.arange(300))
    np.testing.assert_allclose(done.moved, source.vertices, atol=1e-9)
    judged = judge_alignment(source, source, done, UP)
    assert judged.total == pytest.approx(0.0, abs=1e-6)
    assert judged.inside_out == pytest.approx(0.0, abs=1e-6)
    assert judged.fallen == pytest.approx(0.0, abs=1e-6)
    assert judged.improper == 0.0


def test_a_true_match_gives_its_rotation(source):
    turn = Rotation.from_euler("xyz", [20, 130, -50], degrees=True).as_matrix()
    turned = replace(source, vertices=source.vertices @ turn.T, normals=source.normals @ turn.T)
    start = start_from_match(source, turned, np.arange(300), "known")
    np.testing.assert_allclose(start.source_from_target, turn.T, atol=1e-9)


def test_deforming_to_a_stretched_copy_stretches(source):
    goals = source.vertices[source.samples] * [1.0, 1.2, 1.0]
    moved = deform_towards(source, goals, 40, stiffness=0.0)
    np.testing.assert_allclose(moved, source.vertices * [1.0, 1.2, 1.0], atol=0.02)


def test_orientation_operators_change_sign_in_a_mirror(source):
    few = source.basis.first(10)
    field = source.vertices[:, :1]
    upright = orientations(few, source.faces, field)
    np.testing.assert_allclose(
        orientations(few, source.faces[:, ::-1].copy(), field), -upright, atol=1e-12
    )


def test_an_orientation_operator_by_hand():
    """One triangle, f = x, h = y: normal . (grad x X grad y) = 1 on an area of one half."""
    functions = np.column_stack([np.ones(3), [0.0, 0.0, 1.0]])
    basis = Basis(np.zeros(2), functions, np.full(3, 1 / 6))
    operator = orientations(basis, np.array([[0, 1, 2]]), np.array([[0.0], [1.0], [0.0]]))
    np.testing.assert_allclose(operator[0], [[0, 1 / 2], [0, 1 / 6]])


def test_commutation_is_the_sum_of_squares(rng):
    first, second, matrix = (rng.normal(size=(3, 4, 4)) for _ in range(3))
    written = sum(
        ((matrix[0] @ a - b @ matrix[0]) ** 2).sum() for a, b in zip(first, second, strict=True)
    )
    form = commutation(first, second)
    assert matrix[0].ravel() @ form @ matrix[0].ravel() == pytest.approx(written)


def test_multiplication_by_one_is_the_identity(source):
    ones = np.ones((len(source.vertices), 1))
    few = source.basis.first(6)
    np.testing.assert_allclose(multiplications(few, source.faces, ones)[0], np.eye(6), atol=1e-9)


def test_signatures_of_a_copy_give_the_identity(source):
    matrix = fit_descriptor_map(source, source, size=15)
    assert np.linalg.norm(matrix - np.eye(15)) < 0.1
    start = start_from_descriptors(source, source)[0]
    error = source.vertices[source.samples[start.matched]] - source.vertices[source.samples]
    assert np.linalg.norm(error, axis=1).mean() < 0.02


def test_the_mirror_of_the_rest_pose_swaps_sides(source):
    opposite = mirror_match(source, UP)
    points = source.vertices[source.samples]
    gap = points[opposite] - points * [-1.0, 1.0, 1.0]
    assert np.linalg.norm(gap, axis=1).mean() < 0.03  # samples lie .05 apart


def test_a_mirrored_map_turns_the_volume_inside_out(source):
    opposite = mirror_match(source, UP)
    right = fit_map(source, source, np.arange(300), 20)
    swapped = fit_map(source, source, opposite, 20)
    assert volume_ratio(source, source, right) == pytest.approx(1.0, abs=0.05)
    assert volume_ratio(source, source, swapped) < -0.5


def test_regions_of_a_mirror_image_are_improper(source):
    rotations, bending, improper = region_rotations(source, source.vertices)
    np.testing.assert_allclose(rotations, np.tile(np.eye(3), (64, 1, 1)), atol=1e-9)
    assert bending == pytest.approx(0.0, abs=1e-6)
    assert improper == 0.0
    assert region_rotations(source, source.vertices * [-1, 1, 1])[2] == pytest.approx(1.0)


def test_distance_sees_normals_turned_over(source):
    assert mutual_distance(source, source, source.vertices) == pytest.approx(0.0, abs=1e-12)
    inside_out = replace(source, normals=-source.normals)
    assert mutual_distance(source, inside_out, source.vertices) > 0.5


def test_swapping_front_and_back_and_sides_is_found_out(source):
    """The turn by 180 degrees keeps the volume's sign; only geometry tells."""
    half = heading_rotations(UP, 2)[1]
    judged = [
        judge_alignment(
            source,
            source,
            align_shells(source, source, start_from_rotation(source, source, turn, "")),
            UP,
        )
        for turn in (np.eye(3), half)
    ]
    assert judged[0].total + 0.2 < judged[1].total


def test_faults_of_the_identity_are_none_and_of_noise_are_many(source, rng):
    assert match_faults(source, source, np.eye(20)) == pytest.approx(0.0, abs=1e-6)
    assert match_faults(source, source, rng.normal(size=(20, 20))) > 0.9


def test_signs_find_a_posed_body_without_any_heading(source, target):
    starts = start_from_signs(source, target, mirror_match(source, UP))
    assert 1 <= len(starts) <= 6
    errors = [
        Rotation.from_matrix(
            start.source_from_target @ Rotation.from_euler("y", 110, degrees=True).as_matrix()
        ).magnitude()
        for start in starts
    ]
    assert min(errors) < np.radians(30)
    for start in starts:  # mirrored candidates were composed with the source's mirror map
        assert volume_ratio(source, target, fit_map(source, target, start.matched, 20)) > 0


def test_a_posed_turned_and_scaled_body_is_matched(source_mesh, target_mesh, target_character):
    found = match_surfaces(source_mesh, target_mesh, modes=60)
    assert place_error(source_mesh, target_character, found.point_map) < 0.03
    assert found.matrix.shape == (60, 60)
    assert found.origin.startswith("heading")
    assert not found.mirrored
    assert found.runner_up > 0.05
    again = match_surfaces(source_mesh, target_mesh, modes=60)
    np.testing.assert_array_equal(again.matrix, found.matrix)


@pytest.mark.parametrize("tilt", [(85, 0, 0), (20, 30, 170)])
def test_a_lying_body_is_matched(source_mesh, target_mesh, target_character, tilt):
    turn = Rotation.from_euler("xyz", tilt, degrees=True).as_matrix()
    lying = Mesh(target_mesh.vertices @ turn.T, target_mesh.faces)
    found = match_surfaces(source_mesh, lying, modes=60)
    assert place_error(source_mesh, target_character, found.point_map) < 0.03
    assert not found.mirrored


def test_bodies_with_holes_are_matched(source_mesh, target_mesh, target_character):
    """Nothing assumes a closed surface: both feet are cut off open."""
    low = target_mesh.vertices[:, 1].min() + 0.1
    faces = target_mesh.faces[(target_mesh.vertices[target_mesh.faces][:, :, 1] > low).all(axis=1)]
    found = match_surfaces(source_mesh, Mesh(target_mesh.vertices, faces), modes=60)
    kept = np.unique(faces)
    gap = source_mesh.vertices[found.point_map] - target_character.mesh.vertices
    assert np.linalg.norm(gap[kept], axis=1).mean() < 0.03


def test_a_point_cloud_is_matched(source_mesh, target_mesh, target_character):
    cloud = Mesh(target_mesh.vertices, np.zeros((0, 3), np.int64))
    found = match_surfaces(source_mesh, cloud, modes=40)
    assert place_error(source_mesh, target_character, found.point_map) < 0.04


def test_an_unlike_surface_scores_badly(source_mesh, caplog):
    ball = trimesh.creation.icosphere(subdivisions=3)
    with caplog.at_level(logging.INFO):
        found = match_surfaces(
            source_mesh, Mesh(np.array(ball.vertices), np.array(ball.faces)), modes=60
        )
    assert found.score > 0.5
    assert "map from" in caplog.text


def test_a_surface_too_small_for_its_modes_is_refused(cube, source_mesh):
    with pytest.raises(ValueError, match="100 eigenfunctions need more than 100 vertices"):
        match_surfaces(source_mesh, cube)


def test_too_few_modes_are_refused(source_mesh):
    with pytest.raises(ValueError, match="modes must be at least 20 to tell limbs apart, got 12"):
        match_surfaces(source_mesh, source_mesh, modes=12)

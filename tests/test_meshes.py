import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku import meshes
from bunraku.types import Mesh

TRIANGLE = Mesh(np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))


def test_a_triangle_by_hand():
    np.testing.assert_array_equal(
        meshes.face_normals(TRIANGLE.vertices, TRIANGLE.faces), [[0, 0, 2]]
    )
    assert meshes.surface_area(TRIANGLE.vertices, TRIANGLE.faces) == 1.0
    np.testing.assert_allclose(meshes.vertex_areas(TRIANGLE.vertices, TRIANGLE.faces), 1 / 3)
    np.testing.assert_array_equal(
        meshes.vertex_normals(TRIANGLE.vertices, TRIANGLE.faces), [[0, 0, 1]] * 3
    )


def test_a_cube_by_hand(cube):
    assert np.isclose(meshes.surface_area(cube.vertices, cube.faces), 6.0)
    assert np.isclose(meshes.signed_volume(cube.vertices, cube.faces), 1.0)
    assert np.isclose(meshes.signed_volume(cube.vertices, cube.faces[:, ::-1]), -1.0)
    assert meshes.is_closed(cube.faces)


def test_area_volume_and_normals_follow_a_rigid_motion(cube):
    turn = Rotation.from_rotvec([0.3, -0.4, 0.5]).as_matrix()
    moved = cube.vertices @ turn.T + [1.0, 2.0, 3.0]
    assert np.isclose(meshes.surface_area(moved, cube.faces), 6.0)
    assert np.isclose(meshes.signed_volume(moved, cube.faces), 1.0)
    np.testing.assert_allclose(
        meshes.vertex_normals(moved, cube.faces),
        meshes.vertex_normals(cube.vertices, cube.faces) @ turn.T,
        atol=1e-12,
    )


def test_vertex_areas_share_out_the_whole_surface(creature):
    vertices, faces = creature.mesh.vertices, creature.mesh.faces
    areas = meshes.vertex_areas(vertices, faces)
    assert np.isclose(areas.sum(), meshes.surface_area(vertices, faces))


def test_sum_at_vertices_agrees_with_a_loop(cube, rng):
    values = rng.normal(size=(len(cube.faces), 2, 3))
    expected = np.zeros((8, 2, 3))
    for face, value in zip(cube.faces, values, strict=True):
        for corner in face:
            expected[corner] += value
    np.testing.assert_allclose(meshes.sum_at_vertices(values, cube.faces, 8), expected)


def test_a_vertex_without_faces_has_no_normal_and_no_area():
    vertices = np.vstack([TRIANGLE.vertices, [[5.0, 5, 5]]])
    assert not meshes.vertex_normals(vertices, TRIANGLE.faces)[3].any()
    assert meshes.vertex_areas(vertices, TRIANGLE.faces)[3] == 0
    np.testing.assert_array_equal(meshes.referenced(TRIANGLE.faces, 4), [True, True, True, False])


def test_vertices_without_any_face_have_no_normals_and_no_areas(rng):
    cloud, none = rng.normal(size=(5, 3)), np.zeros((0, 3), np.int64)
    np.testing.assert_array_equal(meshes.vertex_normals(cloud, none), np.zeros((5, 3)))
    np.testing.assert_array_equal(meshes.vertex_areas(cloud, none), np.zeros(5))


def test_faces_without_area_do_not_disturb_normals():
    faces = np.array([[0, 1, 2], [0, 1, 1], [2, 2, 2]])
    np.testing.assert_array_equal(
        meshes.vertex_normals(TRIANGLE.vertices, faces), [[0, 0, 1.0]] * 3
    )


def test_weld_makes_a_soup_of_triangles_one_closed_mesh(cube, rng):
    soup = cube.vertices[cube.faces].reshape(-1, 3) + rng.uniform(-1e-8, 1e-8, (36, 3))
    vertices, faces, welded_of = meshes.weld(soup, np.arange(36).reshape(-1, 3))
    assert len(vertices) == 8 and meshes.is_closed(faces)
    np.testing.assert_allclose(vertices[welded_of], soup, atol=1e-7)


def test_weld_drops_a_face_that_collapses():
    vertices = np.vstack([TRIANGLE.vertices, TRIANGLE.vertices[:1]])
    _, faces, welded_of = meshes.weld(vertices, np.array([[0, 1, 2], [0, 3, 1]]))
    assert len(faces) == 1 and welded_of[0] == welded_of[3]


def test_weld_keeps_a_mesh_that_has_nothing_to_merge(creature):
    vertices, faces, welded_of = meshes.weld(creature.mesh.vertices, creature.mesh.faces)
    np.testing.assert_array_equal(vertices[welded_of], creature.mesh.vertices)
    np.testing.assert_array_equal(vertices[faces], creature.mesh.vertices[creature.mesh.faces])


def test_connected_parts_of_two_cubes_and_a_stray_vertex(cube):
    parts = meshes.connected_parts(np.vstack([cube.faces, cube.faces + 8]), 17)
    assert len(set(parts[:8])) == len(set(parts[8:16])) == 1 and len(set(parts)) == 3


@pytest.mark.parametrize("spoil", ["hole", "flip", "double", "nothing"])
def test_is_closed_refuses(cube, spoil):
    flipped = cube.faces.copy()
    flipped[0] = flipped[0, ::-1]
    spoilt = {
        "hole": cube.faces[1:],
        "flip": flipped,
        "double": np.vstack([cube.faces, cube.faces[:1]]),
        "nothing": cube.faces[:0],
    }
    assert not meshes.is_closed(spoilt[spoil])


def test_closest_points_by_hand():
    points = np.array([[0.5, 0.25, 3.0], [-4.0, -3.0, 0.0], [1.0, -2.0, 0.0]])
    face, barycentric, distance = meshes.closest_points(points, TRIANGLE.vertices, TRIANGLE.faces)
    np.testing.assert_array_equal(face, 0)
    np.testing.assert_allclose(distance, [3, 5, 2])
    np.testing.assert_allclose(barycentric, [[0.5, 0.25, 0.25], [1, 0, 0], [0.5, 0.5, 0]])


def test_closest_points_agree_with_a_dense_sampling(creature, rng):
    vertices, faces = creature.mesh.vertices, creature.mesh.faces
    points = rng.uniform(-0.6, 1.2, (20, 3))
    face, barycentric, distance = meshes.closest_points(points, vertices, faces)
    nearest = meshes.interpolate(vertices, faces[face], barycentric)
    np.testing.assert_allclose(np.linalg.norm(nearest - points, axis=1), distance, atol=1e-9)
    samples, shares = meshes.sample_surface(vertices, faces, 40_000, rng)
    dense = meshes.interpolate(vertices, faces[samples], shares)
    plain = np.linalg.norm(points[:, None] - dense[None], axis=2).min(axis=1)
    assert (distance <= plain + 1e-9).all() and (plain - distance).max() < 0.01


def test_closest_point_of_a_face_without_area_is_still_finite():
    vertices, faces = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([[0, 1, 2]])
    _, barycentric, distance = meshes.closest_points(np.array([[1.0, 1, 0]]), vertices, faces)
    assert np.isfinite(barycentric).all() and np.isclose(barycentric.sum(), 1)
    assert np.isclose(distance[0], 1.0)


def test_interpolating_positions_gives_the_points(cube, rng):
    face, barycentric = meshes.sample_surface(cube.vertices, cube.faces, 50, rng)
    points = meshes.interpolate(cube.vertices, cube.faces[face], barycentric)
    on_a_side = np.isclose(points, 0) | np.isclose(points, 1)
    assert on_a_side.any(axis=1).all() and ((points >= 0) & (points <= 1)).all()


def test_sample_surface_draws_by_area(rng):
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [8, 0, 0], [5, 1, 0]])
    face, barycentric = meshes.sample_surface(vertices, np.array([[0, 1, 2], [3, 4, 5]]), 8000, rng)
    assert abs((face == 1).mean() - 0.75) < 0.02
    np.testing.assert_allclose(barycentric.mean(axis=0), 1 / 3, atol=0.02)


def test_farthest_points_by_hand():
    line = np.array([[0.0], [1.0], [2.0], [10.0]])
    np.testing.assert_array_equal(meshes.farthest_points(line, 3), [3, 0, 2])
    np.testing.assert_array_equal(meshes.farthest_points(line, 9, start=1), [1, 3, 0, 2])


def test_farthest_points_agree_with_the_definition(rng):
    points = rng.normal(size=(60, 3))
    chosen = meshes.farthest_points(points, 12)
    np.testing.assert_array_equal(meshes.farthest_points(points, 5), chosen[:5])
    for i in range(1, 12):
        distance = np.linalg.norm(points[:, None] - points[chosen[:i]][None], axis=2).min(axis=1)
        assert chosen[i] == distance.argmax()


def test_scaling_to_unit_area_and_back(creature):
    vertices, faces = creature.mesh.vertices, creature.mesh.faces
    unit, centre, scale = meshes.scale_to_unit_area(vertices, faces)
    assert np.isclose(meshes.surface_area(unit, faces), 1.0)
    np.testing.assert_allclose(unit.mean(axis=0), 0, atol=1e-12)
    np.testing.assert_allclose(unit * scale + centre, vertices, atol=1e-12)


def test_rows_are_summed_by_place(rng):
    place, values = np.array([2, 0, 2, 2]), rng.normal(size=(4, 5))
    sums = meshes.sum_rows(place, values, 3)
    np.testing.assert_allclose(sums[2], values[[0, 2, 3]].sum(axis=0))
    np.testing.assert_allclose(sums[1], 0.0)

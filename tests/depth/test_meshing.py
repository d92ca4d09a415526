import numpy as np

from bunraku.depth.meshing import denoise, grid_faces, large_parts, mesh_frame
from bunraku.depth.projection import back_project, pixel_rays, project_points
from bunraku.meshes import face_normals

LENS = np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])


def test_the_middle_pixel_looks_straight_ahead_and_up_is_up():
    depth = np.full((48, 64), 2.0)
    points = back_project(depth, LENS)
    np.testing.assert_allclose(points[23, 31], [-1 / 60, 1 / 60, -2.0], atol=1e-12)
    assert (points[0, :, 1] > 0).all() and (points[:, -1, 0] > 0).all()
    np.testing.assert_allclose(pixel_rays((64, 48), LENS), points / 2)


def test_projection_undoes_back_projection(rng):
    depth = 1 + rng.random((48, 64))
    pixels = project_points(back_project(depth, LENS), LENS)
    rows, columns = np.indices((48, 64))
    np.testing.assert_allclose(pixels, np.stack([columns, rows], axis=-1), atol=1e-9)


def test_a_wall_becomes_a_sheet_that_faces_the_camera():
    view = mesh_frame(np.full((48, 64), 2.0), np.ones((48, 64), bool), LENS, 3.0)
    assert len(view.vertices) == 48 * 64 and len(view.faces) == 2 * 47 * 63
    assert (face_normals(view.vertices, view.faces)[:, 2] > 0).all()
    np.testing.assert_allclose(view.normals, np.tile([0.0, 0, 1], (48 * 64, 1)), atol=1e-9)
    rows, columns = view.pixels.T
    np.testing.assert_allclose(back_project(view.depth, LENS)[rows, columns], view.vertices)


def test_edges_across_a_jump_in_depth_are_cut():
    depth = np.full((48, 64), 2.0)
    depth[:, 32:] = 2.5
    view = mesh_frame(depth, np.ones((48, 64), bool), LENS, 3.0)
    jump = np.ptp(view.vertices[view.faces][:, :, 2], axis=1)
    assert jump.max() < 0.05
    assert len(view.vertices) == 48 * 64


def test_noise_falls_and_edges_stay(rng):
    depth = np.full((48, 64), 2.0)
    depth[:, 32:] = 2.5
    noisy = depth + 0.01 * rng.standard_normal(depth.shape)
    clean = denoise(noisy, LENS, 3.0)
    assert np.abs(clean - depth).mean() < 0.4 * np.abs(noisy - depth).mean()
    assert np.abs(clean - depth).max() < 0.03
    assert not denoise(np.zeros((8, 8)), LENS, 1.0).any()


def test_scraps_are_dropped():
    points = np.zeros((30, 40, 3))
    points[..., 2] = -1.0
    points[:, 30:, 2] = 0.0  # nothing seen
    points[5:8, 33:36, 2] = -1.0
    rows, columns = np.indices((30, 40))
    points[..., 0], points[..., 1] = 0.01 * columns, -0.01 * rows
    faces = grid_faces(points, 0.1)
    kept = large_parts(faces, 30 * 40).reshape(30, 40)
    assert kept[:, :30].all() and not kept[:, 30:].any()

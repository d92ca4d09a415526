import numpy as np

from bunraku.formats.polygons import triangulate


def areas(points, faces):
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals[:, 2] / 2


def test_a_quad_is_a_fan_of_two():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces, polygon = triangulate(points, np.arange(4), np.array([0, 4]))
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert polygon.tolist() == [0, 0]


def test_polygons_of_mixed_sizes_keep_their_order():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    corners = np.array([0, 1, 2, 0, 1, 2, 3, 0, 2, 3])
    faces, polygon = triangulate(points, corners, np.array([0, 3, 7, 10]))
    assert corners[faces].tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3], [0, 2, 3]]
    assert polygon.tolist() == [0, 1, 1, 2]


def test_an_arrow_head_is_cut_along_its_inside():
    points = np.array([[0.0, 0, 0], [2, 1, 0], [0, 2, 0], [0.5, 1, 0]])  # bends in at the last
    for first in range(4):
        corners = np.roll(np.arange(4), first)
        faces, _ = triangulate(points, corners, np.array([0, 4]))
        found = areas(points, corners[faces])
        assert (found > 0).all()
        np.testing.assert_allclose(found.sum(), 1.5)


def test_concave_stars_keep_area_and_side(rng):
    for corner_count in (6, 9, 20):
        angles = np.linspace(0, 2 * np.pi, corner_count, endpoint=False)
        radii = rng.uniform(0.3, 1.0, corner_count)
        points = np.stack([radii * np.cos(angles), radii * np.sin(angles), 0 * angles], axis=1)
        for turned in (points, points[::-1]):
            faces, _ = triangulate(turned, np.arange(corner_count), np.array([0, corner_count]))
            following = np.roll(turned, -1, axis=0)
            whole = np.cross(turned, following)[:, 2].sum() / 2
            assert len(faces) == corner_count - 2
            np.testing.assert_allclose(areas(turned, faces).sum(), whole)
            assert (areas(turned, faces) * np.sign(whole) > -1e-12).all()


def test_no_polygons_give_no_triangles():
    faces, polygon = triangulate(np.empty((0, 3)), np.empty(0, np.int64), np.array([0]))
    assert faces.shape == (0, 3)
    assert polygon.shape == (0,)


def test_a_polygon_that_crosses_itself_ends_as_some_triangles(rng):
    points = rng.normal(size=(250, 3)) * [1, 1, 0]
    faces, _ = triangulate(points, np.arange(250), np.array([0, 250]))
    assert len(faces) == 248
    assert faces.min() == 0
    assert faces.max() == 249


def test_a_huge_concave_polygon_is_a_fan_soon(rng):
    points = rng.normal(size=(3000, 3))
    faces, _ = triangulate(points, np.arange(3000), np.array([0, 3000]))
    assert (faces[:, 0] == 0).all()

import numpy as np
import pytest

from bunraku.depth.projection import project_points
from bunraku.evaluate.rendering import (
    Sensor,
    default_intrinsics,
    ray_cosines,
    render_depth,
    spoil_depth,
    true_paths,
    vertex_visibility,
    view_from,
)


@pytest.fixture
def plate():
    """A square two metres away that faces the camera."""
    vertices = np.array([[-0.5, -0.5, -2], [0.5, -0.5, -2], [0.5, 0.5, -2], [-0.5, 0.5, -2.0]])
    return vertices, np.array([[0, 1, 2], [0, 2, 3]])


def test_a_plate_is_seen_at_its_depth_where_it_projects(plate):
    vertices, faces = plate
    depth, face, shares = render_depth(vertices, faces, default_intrinsics())
    seen = face >= 0
    np.testing.assert_allclose(depth[seen], 2.0, atol=1e-6)
    assert not depth[~seen].any()
    assert seen.sum() == pytest.approx((525 / 2) ** 2, rel=0.01)
    rows, columns = np.nonzero(seen)
    places = np.einsum("pc,pca->pa", shares[seen], vertices[faces[face[seen]]])
    pixels = project_points(places, default_intrinsics())
    np.testing.assert_allclose(
        pixels, np.column_stack([columns, rows]), atol=0.01
    )  # rays are single precision
    cosine = ray_cosines(vertices, faces, face, default_intrinsics())
    assert cosine[240, 320] == pytest.approx(1.0, abs=1e-4) and cosine[0, 0] == 0.0


def test_a_sensor_errs_as_told(plate):
    vertices, faces = plate
    depth, face, _ = render_depth(vertices, faces, default_intrinsics())
    cosine = ray_cosines(vertices, faces, face, default_intrinsics())
    perfect = Sensor(0.0, (0.0, 0.0), 0.0, 0.0, 0.0)
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(spoil_depth(depth, cosine, perfect, rng), depth)
    noisy = spoil_depth(depth, cosine, Sensor(), rng)
    inner = noisy[200:280, 280:360]
    kept = inner > 0
    assert 0.99 < kept.mean() < 1.0
    assert inner[kept].std() == pytest.approx(0.0012 + 0.0019 * 1.6**2, rel=0.05)
    np.testing.assert_allclose(inner * 1000, np.rint(inner * 1000), atol=1e-6)


def test_a_subject_is_brought_to_diagonal_2_and_into_view(creature):
    places = np.stack([creature.mesh.vertices, creature.mesh.vertices + np.array([0, 0, 3.0])])
    seen, scale = view_from(places, 40.0)
    first = np.linalg.norm(np.ptp(places[0], axis=0))
    assert scale == pytest.approx(2 / first)
    pixels = project_points(seen, default_intrinsics())
    assert (pixels >= 0).all() and (pixels < [640, 480]).all()
    edge = np.linalg.norm(seen[0, 0] - seen[0, 1]) / np.linalg.norm(places[0, 0] - places[0, 1])
    assert edge == pytest.approx(scale)


def test_truth_follows_the_surface(film):
    _, face, shares = render_depth(film.places[0], film.faces, film.video.intrinsics)
    pixels = np.argwhere(face >= 0)[::50]
    paths = true_paths(film, 0, pixels)
    seen = project_points(paths[0], film.video.intrinsics)
    np.testing.assert_allclose(seen, pixels[:, ::-1], atol=0.01)  # rays are single precision
    corners = film.faces[face[tuple(pixels[3])]]
    expected = shares[tuple(pixels[3])] @ film.places[5][corners]
    np.testing.assert_allclose(paths[5, 3], expected)


def test_a_face_hides_what_is_behind_it(plate):
    vertices, faces = plate
    both = np.concatenate([vertices, 0.5 * vertices + [0, 0, -2.0]])
    depth, _, _ = render_depth(both, np.concatenate([faces, faces + 4]), default_intrinsics())
    inner = np.clip(both, -0.45, 0.45) * [1, 1, 0] + both * [0, 0, 1]
    visible = vertex_visibility(inner, depth, default_intrinsics())
    assert visible.tolist() == [True] * 4 + [False] * 4

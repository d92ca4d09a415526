import numpy as np
from scipy.spatial import ConvexHull

from bunraku.evaluate.metrics import reconstruction_error
from bunraku.evaluate.rendering import true_paths
from bunraku.routes.from_depth import animate_from_depth, capture_performer
from bunraku.skinning import play_clip
from bunraku.types import DepthVideo, Mesh
from tests.creatures import make_creature


def test_the_seen_surface_follows_its_subject(capture, film):
    track = capture.track
    truth = true_paths(film, track.reference, capture.views[track.reference].pixels)
    off = np.linalg.norm(track.places - truth, axis=-1)
    still = np.linalg.norm(truth - truth[track.reference], axis=-1)
    assert still.mean() > 0.1  # it walks and waves
    assert off[track.visible].mean() < 0.03
    assert off.mean() < 0.25 * still.mean()
    assert track.residuals.max() < 0.03


def test_the_performer_moves_as_it_was_tracked(capture):
    performer = capture.character
    moved = play_clip(performer, performer.clips[0]) - capture.eye
    assert np.linalg.norm(moved - capture.track.places, axis=-1).mean() < 0.01
    assert 2 <= len(performer.skeleton.names) <= 30
    assert ((performer.skin.weights > 0).sum(axis=1) <= 4).all()
    np.testing.assert_allclose(performer.clips[0].times, capture.times)
    assert abs(performer.mesh.vertices[:, 1].min()) < 1e-9


def test_the_whole_creature_moves_as_it_did_before_the_camera(capture, film):
    reference = capture.track.reference
    figure = Mesh(film.places[reference], film.faces)
    moved = animate_from_depth(capture, figure)
    frames = play_clip(moved.character, moved.character.clips[0])
    frames = frames - (frames[reference] - figure.vertices).mean(axis=0)
    frozen = np.broadcast_to(figure.vertices, frames.shape)
    assert reconstruction_error(frozen, film.places) > 0.1
    ours = reconstruction_error(frames, film.places)
    assert ours < 0.35 * reconstruction_error(frozen, film.places)
    assert abs(moved.embedding.scale - 1) < 0.03
    assert moved.embedding.matched.mean() > 0.9


def test_a_figure_in_its_own_place_size_and_heading_is_moved(capture):
    """The same creature at rest, seen by no camera: twice the size, facing +Z, far away."""
    other = make_creature(cell=0.03).mesh
    figure = Mesh(2 * other.vertices + [5.0, 0.0, -3.0], other.faces)
    moved = animate_from_depth(capture, figure)
    frames = play_clip(moved.character, moved.character.clips[0])
    own = float(np.linalg.norm(np.ptp(capture.character.mesh.vertices, axis=0)))
    assert 0.7 < moved.embedding.scale * own / np.linalg.norm(np.ptp(figure.vertices, axis=0)) < 1.4
    assert np.isfinite(frames).all()
    assert np.abs(frames[0].mean(axis=0) - figure.vertices.mean(axis=0)).max() < 1.0


def test_a_ball_is_doubted(capture):
    rows, columns = np.meshgrid(np.linspace(0.05, 3.09, 30), np.linspace(0, 2 * np.pi, 40)[:-1])
    ball = [np.sin(rows) * np.cos(columns), np.cos(rows), np.sin(rows) * np.sin(columns)]
    vertices = np.stack(ball, axis=-1).reshape(-1, 3)
    figure = Mesh(vertices, ConvexHull(vertices).simplices.astype(np.int64))
    moved = animate_from_depth(capture, figure, force=True)
    assert moved.confidence < 0.5
    assert any("fits the performer poorly" in told for told in moved.warnings)


def test_equal_input_gives_equal_output(film):
    video = film.video
    short = DepthVideo("x", video.times[:4], video.depths[:4], video.intrinsics)
    first, second = (capture_performer(short) for _ in range(2))
    np.testing.assert_array_equal(
        first.character.clips[0].rotations, second.character.clips[0].rotations
    )


def test_a_subject_that_stands_still_gives_one_bone(film):
    video = film.video
    still = np.repeat(video.depths[:1], 4, axis=0)
    capture = capture_performer(DepthVideo("x", video.times[:4], still, video.intrinsics))
    assert len(capture.character.skeleton.names) == 1

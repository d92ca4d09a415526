from dataclasses import replace

import numpy as np
import pytest

from bunraku.embedding import best_similarity, embed, spread_weights
from bunraku.evaluate.metrics import reconstruction_error
from bunraku.evaluate.report import report_depth_transfer
from bunraku.proxy import build_proxy
from bunraku.routes import following
from bunraku.routes.following import (
    Followed,
    carry_figure,
    follow_figure,
    is_clearly_nearer,
    lay_bones,
    lay_figure,
)
from bunraku.routes.from_depth import animate_from_depth
from bunraku.skinning import play_clip
from bunraku.types import Mesh


@pytest.fixture(scope="module")
def figure(film):
    """The creature as it stood in the first frame, half as large again, elsewhere."""
    return build_proxy(1.5 * film.places[0] + [2.0, 1.0, 0.0], film.faces).mesh


@pytest.fixture(scope="module")
def embedding(capture, figure):
    return embed(capture.character, capture.bones, figure)


def test_the_figure_takes_the_performer_s_shape_and_place(capture, film, figure, embedding):
    weights, _ = spread_weights(capture.character, embedding, figure)
    carried = carry_figure(capture.character, capture.bones, embedding, figure, weights)
    frame = embedding.frame if embedding.frame >= 0 else capture.track.reference
    truth = (figure.vertices - [2.0, 1.0, 0.0]) / 1.5 + capture.eye
    assert np.linalg.norm(carried[frame] - truth, axis=-1).mean() < 0.05
    assert np.linalg.norm(carried - carried[:1], axis=-1).mean() > 0.05


def test_a_broken_skin_makes_the_figure_itself_be_followed(capture, film, figure, embedding):
    """Carried by one bone the figure would hardly move: the depth tells."""
    weights, _ = spread_weights(capture.character, embedding, figure)
    stiff = np.zeros_like(weights)
    stiff[:, 0] = 1.0
    followed = follow_figure(capture, replace(embedding, frame=0), figure, stiff)
    assert followed.whole and len(followed.errors) == len(capture.times)
    moved = play_clip(followed.performer, followed.performer.clips[0]) - capture.eye
    assert len(moved[0]) == len(figure.vertices) == len(followed.weights)
    assert len(followed.joints) == len(followed.turns) == followed.weights.shape[1] > 2
    assert ((followed.weights > 0).sum(axis=1) <= 4).all()
    np.testing.assert_allclose(followed.weights.sum(axis=1), 1.0)
    low, high = figure.vertices.min(axis=0), figure.vertices.max(axis=0)
    assert ((followed.joints > low - 0.1) & (followed.joints < high + 0.1)).all()


def test_a_figure_is_followed_only_where_its_worst_frames_are_nearer_too():
    started = np.linspace(0.02, 0.03, 20)  # as near at the end as at the start, nearly
    lost = np.linspace(0.02, 0.09, 20)
    assert is_clearly_nearer(started, lost, 0)
    assert not is_clearly_nearer(lost, started, 0)
    assert not is_clearly_nearer(started, started, 0)
    # another build: carried it lies far from the depth, but no farther at the end
    assert not is_clearly_nearer(lost, started + 0.1, 0)


def test_a_figure_that_stands_as_the_performer_is_laid_as_it_stands(
    capture, film, figure, embedding
):
    frame = capture.track.reference
    truth = (figure.vertices - [2.0, 1.0, 0.0]) / 1.5 + capture.eye
    whole = best_similarity(truth, figure.vertices, np.ones(len(truth)))
    exact = replace(embedding, whole=whole)
    off = truth + 0.05 * np.sin(9.0 * truth)
    surface, stands = lay_figure(off, exact, figure, capture, frame)
    assert stands
    np.testing.assert_allclose(surface, truth, atol=1e-9)
    other = replace(exact, whole=replace(whole, shift=whole.shift + 0.5))
    surface, stands = lay_figure(off, other, figure, capture, frame)
    assert not stands
    np.testing.assert_array_equal(surface, off)


def test_a_result_that_leaves_much_of_the_motion_is_doubted(capture, embedding):
    still = np.array([0.02, 0.06, 0.10])
    own = np.ones((4, len(embedding.joints))), embedding.joints, embedding.turns

    def doubts(errors: list[float], still: np.ndarray) -> tuple[str, ...]:
        found = Followed(capture.character, *own, np.array(errors), still, whole=False)
        return found.doubts

    assert doubts([0.02, 0.03, 0.03], still) == ()
    (told,) = doubts([0.02, 0.04, 0.06], still)
    assert "by 40 mm" in told and "by 60 mm" in told
    assert doubts([0.023, 0.023, 0.023], np.full(3, 0.022)) == ()  # who stands still may


def test_bones_are_laid_where_their_surface_is(capture, figure, film):
    """A turned, larger copy of the performer itself: every joint lies in the same place on it."""
    performer, bones = capture.character, capture.bones
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    rest = performer.mesh.vertices
    copy = type(figure)(1.5 * rest @ turn.T + [1.0, 2.0, 3.0], performer.mesh.faces)
    joints, turns = lay_bones(performer, bones, copy)
    np.testing.assert_allclose(joints, 1.5 * bones.joints @ turn.T + [1.0, 2.0, 3.0], atol=1e-6)
    np.testing.assert_allclose(turns, np.broadcast_to(turn, turns.shape), atol=1e-6)


def test_the_report_tells_that_the_figure_itself_was_followed(capture, film, monkeypatch):
    figure = Mesh(film.places[0], film.faces)
    count = len(capture.times)
    monkeypatch.setattr(following, "depth_errors", lambda *_: np.zeros(count))
    monkeypatch.setattr(following, "is_clearly_nearer", lambda *_: True)
    moved = animate_from_depth(capture, figure)
    told = report_depth_transfer("figure.ply", "film", capture, moved, total_seconds=1.0)
    assert moved.followed.whole and told["followed"] == "figure"
    assert told["depth_error_m"] == [0.0] * count
    (clip,) = told["clips"]
    assert clip["frames"] == count and np.isfinite(clip["stretch_p99"])
    frames = play_clip(moved.character, moved.character.clips[0])
    frames = frames - (frames[0] - figure.vertices).mean(axis=0)
    frozen = reconstruction_error(np.broadcast_to(figure.vertices, frames.shape), film.places)
    assert reconstruction_error(frames, film.places) < 0.35 * frozen

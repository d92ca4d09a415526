from dataclasses import replace

import numpy as np
import pytest

from bunraku.embedding import (
    Embedding,
    Similarity,
    best_similarity,
    heading_turns,
    share_inside,
    spread_weights,
)
from bunraku.registration.correspondence import make_surface
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Mesh


def test_a_similarity_is_found_again(rng):
    points = rng.normal(size=(40, 3))
    turn, shift = vectors_to_matrices(np.array([0.2, 1.5, -0.4])), np.array([1.0, -2.0, 0.5])
    goals = 1.3 * points @ turn.T + shift
    goals[0] += 50.0  # does not count
    weights = np.ones(40)
    weights[0] = 0.0
    found = best_similarity(points, goals, weights)
    np.testing.assert_allclose(found.rotation, turn, atol=1e-9)
    np.testing.assert_allclose(found.shift, shift, atol=1e-9)
    assert found.scale == pytest.approx(1.3)


def test_joints_inside_or_nearly_so_are_counted(cube):
    surface = make_surface(cube.vertices, cube.faces)
    joints = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 1.01], [0.5, 0.5, 1.5], [9.0, 0, 0]])
    assert share_inside(joints, surface) == 0.5


def test_headings_are_turns_about_the_vertical():
    turns = heading_turns(8)
    np.testing.assert_allclose(turns[0], np.eye(3), atol=1e-12)
    np.testing.assert_allclose(turns[2] @ [0.0, 0, 1], [1.0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(turns @ [0.0, 1, 0], np.tile([0.0, 1, 0], (8, 1)), atol=1e-12)


def test_weights_are_the_seen_ones_where_seen_and_spread_elsewhere(capture, film):
    """The figure is the subject as it stood in the reference frame, in its own place."""
    performer, reference = capture.character, capture.track.reference
    figure = Mesh(film.places[reference] + capture.eye, film.faces)
    bones = len(performer.skeleton.names)
    exact = Embedding(
        np.eye(3),
        np.tile(np.eye(3), (bones, 1, 1)),
        capture.bones.joints,
        performer.mesh.vertices,
        1.0,
        0.0,
        np.ones(bones),
        1.0,
        np.tile(np.eye(3), (bones, 1, 1)),
        -1,
        Similarity(np.eye(3), np.zeros(3), 1.0),
    )
    weights, met = spread_weights(performer, exact, figure)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert (weights >= 0).all()
    assert 0.2 < met.mean() < 0.8  # one side is seen
    nearest = np.linalg.norm(
        figure.vertices[met][:200, None] - performer.mesh.vertices[None], axis=-1
    ).argmin(axis=1)
    agree = np.abs(weights[met][:200] - performer.skin.weights[nearest]).sum(axis=1)
    assert np.median(agree) < 0.2
    assert exact.confidence == 1.0 and exact.doubts == ()
    lost = replace(exact, matched=np.eye(bones)[0], misfit=0.8, inside=0.5)
    assert "bone01" in lost.doubts[0] and "poorly" in lost.doubts[2]
    assert "50% of the joints lie outside" in lost.doubts[1]
    assert lost.confidence < 0.2

from dataclasses import replace

import numpy as np
import pytest

from bunraku.registration.moments import Moments, no_moments
from bunraku.reposing.energy import place_joints
from bunraku.reposing.slides import expected_slides, undo_slides
from bunraku.rotations import vectors_to_matrices
from tests.creatures import JOINTS, NAMES, PARENTS, pose_of

HEAD, CHEST, LEG = (NAMES.index(name) for name in ("head", "chest", "leftLeg"))


def bowed(degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Bow; the head slides out of the chest by a millimetre a degree, up along the chest."""
    turns = pose_of({"chest": (degrees, 0.0, 0.0), "leftLeg": (-degrees, 0.0, 0.0)})
    slid = JOINTS.copy()
    slid[HEAD, 1] += 1e-3 * degrees
    return place_joints(slid, PARENTS, turns, np.zeros(3))


@pytest.fixture
def bowing(body):
    """The creature with one clip in which its head slides as it bows."""
    frames = [bowed(degrees) for degrees in (0.0, 10.0, 20.0, 30.0, 40.0)]
    turns = np.array([turn for _, turn in frames])
    places = np.array([place for place, _ in frames])
    return replace(body, moments=Moments(turns, turns, places, np.arange(5)))


def test_a_pose_of_the_clips_has_its_slides(bowing):
    slides = expected_slides(bowing, bowed(30.0)[1])
    assert slides[HEAD, 1] == pytest.approx(0.03, rel=0.1)  # measured .0294: the ridge holds back
    slides[HEAD, 1] = 0.0
    np.testing.assert_allclose(slides, 0, atol=1e-12)


def test_at_rest_and_without_clips_nothing_slides(bowing, body):
    still = np.tile(np.eye(3), (7, 1, 1))
    np.testing.assert_allclose(expected_slides(bowing, still), 0, atol=1e-12)
    nothing = no_moments(7)
    silent = replace(body, moments=nothing)
    assert undo_slides(JOINTS, silent, bowed(30.0)[1], 1.0) is JOINTS


def test_a_character_that_only_stands_teaches_nothing(bowing):
    still = np.tile(np.eye(3), (4, 7, 1, 1))
    moments = Moments(still, still, np.tile(JOINTS, (4, 1, 1)), np.arange(4))
    quiet = replace(bowing, moments=moments)
    np.testing.assert_array_equal(expected_slides(quiet, bowed(30.0)[1]), 0)


def test_slides_are_undone_at_the_figures_size(bowing):
    slid = 2 * JOINTS
    slid[HEAD, 1] += 0.06
    undone = undo_slides(slid, bowing, bowed(30.0)[1], 1.0)
    np.testing.assert_allclose(undone, 2 * JOINTS, atol=6e-3)
    half = undo_slides(slid, bowing, bowed(30.0)[1], 0.5)
    assert half[HEAD, 1] - 2 * JOINTS[HEAD, 1] == pytest.approx(0.03, abs=4e-3)


def test_where_and_how_the_body_stands_does_not_matter(bowing):
    """The hips' own turn and place are no turn and no slide of a joint on its carrier."""
    seen, whole = bowing.moments, vectors_to_matrices(np.array([0.0, 2.5, 0.0]))
    turns, places = whole @ seen.turns, seen.places @ whole.T + np.ones(3)
    away = replace(bowing, moments=Moments(turns, turns, places, seen.unlike))
    bow = bowed(30.0)[1]
    np.testing.assert_allclose(expected_slides(away, bow), expected_slides(bowing, bow), atol=1e-12)
    turned = expected_slides(bowing, whole @ bow)
    np.testing.assert_allclose(turned, expected_slides(bowing, bow), atol=1e-12)


def test_what_a_clip_stretches_or_hides_has_not_slid(bowing):
    """The chest twice as large, and in one moment scaled to nothing."""
    seen = bowing.moments
    scale = np.array([2.0, 2.0, 2.0, 2.0, 1e-9])[:, None]
    places, linear = seen.places.copy(), seen.linear.copy()
    chest = places[:, CHEST].copy()
    for joint in np.flatnonzero(PARENTS == CHEST):
        places[:, joint] = chest + scale * (places[:, joint] - chest)
    linear[:, CHEST] *= scale[..., None]
    stretched = replace(bowing, moments=Moments(seen.turns, linear, places, seen.unlike))
    slides = expected_slides(stretched, bowed(30.0)[1])
    assert 0.01 < slides[HEAD, 1] < 0.03  # measured .0139; .072 if stretching were sliding
    slides[HEAD, 1] = 0.0
    np.testing.assert_allclose(slides, 0, atol=1e-12)

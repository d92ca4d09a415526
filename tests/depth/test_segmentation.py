import numpy as np
import pytest

from bunraku.depth.segmentation import find_subject, scene_planes
from bunraku.depth.subject import view_subject
from bunraku.types import DepthVideo

LENS = np.array([[120.0, 0, 63.5], [0, 120, 47.5], [0, 0, 1]])


def room(frames=6):
    """A ball that rolls through a room: floor, back wall, and a chest that stands still."""
    rows, columns = np.indices((96, 128))
    floor = 0.8 * 120 / np.maximum(rows - 47.5, 1e-6)
    scene = np.minimum(np.where(rows > 47.5, floor, 9.0), 3.0)
    chest = (np.abs(columns - 100) < 12) & (rows > 40) & (rows < 75)
    scene = np.where(chest, 2.2, scene)
    depths, truth = [], []
    for frame in range(frames):
        ball = np.hypot(columns - 30 - 5 * frame, rows - 45) < 14
        depths.append(np.where(ball, 1.6, scene))
        truth.append(ball)
    return np.stack(depths).astype(np.float32), np.stack(truth)


def video(depths, masks=None):
    return DepthVideo("x", np.arange(len(depths)) / 30, depths, LENS, masks)


def overlap(found, truth):
    return (found & truth).sum() / (found | truth).sum()


def test_before_nothing_the_subject_is_what_was_measured():
    depths, truth = room()
    found = find_subject(video(np.where(truth, depths, 0)))
    assert overlap(found, truth) > 0.97


def test_what_moves_before_floor_and_wall_is_the_subject(rng):
    depths, truth = room()
    depths = depths + 0.004 * rng.standard_normal(depths.shape).astype(np.float32)
    assert overlap(find_subject(video(depths)), truth) > 0.9


def test_floor_and_wall_are_found():
    planes = scene_planes(room()[0][0].astype(float), LENS)
    normals = np.array([normal for normal, _ in planes])
    assert np.abs(normals @ [0, 1, 0]).max() > 0.99
    assert np.abs(normals @ [0, 0, 1]).max() > 0.99


def test_a_mask_is_believed():
    depths, _ = room()
    masks = np.zeros(depths.shape, bool)
    masks[:, 50:70, 90:110] = True
    np.testing.assert_array_equal(find_subject(video(depths, masks)), masks)


def test_no_subject_or_one_frame_of_it_is_refused():
    depths, truth = room()
    with pytest.raises(ValueError, match="shows no subject"):
        view_subject(video(np.zeros_like(depths)))
    alone = np.where(truth, depths, 0)
    alone[1:] = 0
    with pytest.raises(ValueError, match="in 1 of 6 frames"):
        view_subject(video(alone))


def test_frames_without_the_subject_are_bridged():
    depths, truth = room()
    alone = np.where(truth, depths, 0)
    alone[[0, 3]] = 0
    seen = view_subject(video(alone))
    np.testing.assert_allclose(seen.times * 30, [0, 1, 3, 4])
    assert "out of sight in 2 of 6 frames" in seen.warnings[0]

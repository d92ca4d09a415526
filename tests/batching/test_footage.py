import numpy as np
import pytest

from bunraku.batching.footage import (
    FOLLOWED,
    ROWS,
    SEEN,
    decode_footage,
    encode_footage,
    make_footage,
)
from bunraku.skinning import play_clip


@pytest.fixture(scope="module")
def footage(capture):
    return make_footage(capture)


def test_points_lie_on_the_performer(footage, capture):
    """Depth, followed points and the captured character are in one frame, at every time."""
    character = capture.character
    moved = play_clip(character, character.clips[0])
    size = capture.diagonal
    assert len(footage.times) == len(moved)
    for frame in (0, len(moved) // 2, len(moved) - 1):
        for points in (footage.seen[frame], footage.followed[frame]):
            apart = np.linalg.norm(points[:, None] - moved[frame], axis=-1).min(axis=1)
            assert np.median(apart) < 0.02 * size
    still = np.linalg.norm(footage.followed[0] - footage.followed[len(moved) // 2], axis=-1)
    assert still.max() > 0.05 * size


def test_sizes_are_bounded(footage):
    frames = len(footage.times)
    assert footage.seen.shape == (frames, SEEN, 3)
    assert footage.followed.shape[1] <= FOLLOWED
    assert footage.visible.shape == footage.followed.shape[:2]
    assert footage.pictures.shape[1] <= ROWS
    assert footage.pictures.max() == 255
    assert (footage.pictures == 0).any()


def test_it_comes_back(footage):
    back = decode_footage(encode_footage(footage))
    for name, array in vars(footage).items():
        np.testing.assert_array_equal(getattr(back, name), array)


def test_the_frame_of_a_time(footage):
    assert footage.frame(footage.times[0]) == 0
    assert footage.frame(footage.times[3]) == 3
    assert footage.frame(footage.times[-1] + 1) == len(footage.times) - 1

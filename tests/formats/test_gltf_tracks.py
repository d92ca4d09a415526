import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from bunraku.formats.gltf import read_character
from bunraku.types import FormatError
from tests.formats.made_gltf import made_arm


def read_clip(*tracks):
    made = made_arm(clip=False)
    made.clip("c", *tracks)
    return read_character("arm.glb", made.glb()).clips[0]


def quaternions(count, rng):
    return Rotation.random(count, rng=rng).as_quat().astype(np.float32)


def test_straight_lines_keep_their_keys():
    clip = read_clip((2, "translation", [0.5, 1, 2], [[1, 0, 0], [1, 1, 0], [1, 1, 1]], "LINEAR"))
    np.testing.assert_allclose(clip.times, [0.5, 1, 2])
    np.testing.assert_allclose(clip.translations[:, 1], [[1, 0, 0], [1, 1, 0], [1, 1, 1]])
    np.testing.assert_allclose(clip.rotations[:, 1], [[0, 0, 0, 1]] * 3)


def test_different_key_times_are_united(rng):
    """Values between keys agree with SciPy's own interpolation."""
    turns = quaternions(3, rng)
    clip = read_clip(
        (2, "rotation", [0, 1, 2], turns, "LINEAR"),
        (2, "scale", [0.25, 1.5], [[1, 1, 1], [2, 2, 2]], "LINEAR"),
    )
    np.testing.assert_allclose(clip.times, [0, 0.25, 1, 1.5, 2])
    expected = Slerp([0, 1, 2], Rotation.from_quat(turns))(clip.times)
    assert (expected.inv() * Rotation.from_quat(clip.rotations[:, 1])).magnitude().max() < 1e-6
    np.testing.assert_allclose(clip.scales[:, 1, 0], [1, 1, 1.6, 2, 2])


def test_rotations_go_the_shorter_way():
    half = np.sqrt(0.5)
    clip = read_clip(
        (2, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, -half, -half]], "LINEAR"),
        (2, "scale", [0, 0.5, 1], [[1, 1, 1], [2, 2, 2], [1, 1, 1]], "LINEAR"),
    )
    angles = Rotation.from_quat(clip.rotations[:, 1]).magnitude()
    np.testing.assert_allclose(np.degrees(angles), [0, 45, 90], atol=1e-4)


def test_steps_hold_and_are_sampled_densely():
    clip = read_clip((2, "translation", [0, 1, 2], [[1, 0, 0], [5, 0, 0], [9, 0, 0]], "STEP"))
    assert np.diff(clip.times).max() < 1 / 59
    places = clip.translations[:, 1, 0]
    np.testing.assert_allclose(places[clip.times < 0.99], 1)
    np.testing.assert_allclose(places[(clip.times > 1) & (clip.times < 1.99)], 5)
    assert places[-1] == 9


def test_steps_that_stand_still_need_no_samples():
    clip = read_clip((2, "translation", [0, 1], [[1, 0, 0], [1.00001, 0, 0]], "STEP"))
    np.testing.assert_allclose(clip.times, [0, 1])


def test_cubic_splines_agree_with_the_formula(rng):
    """Specification, appendix C.5, written out for one moment at a time."""
    keys, times = rng.normal(size=(3, 3, 3)), np.array([0.0, 0.7, 1.5])
    clip = read_clip((2, "translation", times, keys.reshape(9, 3), "CUBICSPLINE"))
    for time, found in zip(clip.times, clip.translations[:, 1], strict=True):
        k = 0 if time < 0.7 else 1
        length = times[k + 1] - times[k]
        t = (time - times[k]) / length
        (_, start, leaving), (arriving, end, _) = keys[k], keys[k + 1]
        expected = (
            (2 * t**3 - 3 * t**2 + 1) * start
            + length * (t**3 - 2 * t**2 + t) * leaving
            + (-2 * t**3 + 3 * t**2) * end
            + length * (t**3 - t**2) * arriving
        )
        np.testing.assert_allclose(found, expected, atol=1e-5)


def test_cubic_rotations_stay_unit(rng):
    keys = np.concatenate([quaternions(1, rng)] * 6) + 0.1 * rng.normal(size=(6, 4))
    clip = read_clip((2, "rotation", [0, 1], keys, "CUBICSPLINE"))
    np.testing.assert_allclose(np.linalg.norm(clip.rotations, axis=-1), 1.0)


def test_one_key_is_a_pose():
    clip = read_clip((2, "translation", [0.3], [[1, 2, 3]], "LINEAR"))
    np.testing.assert_allclose(clip.times, [0.3])
    np.testing.assert_allclose(clip.translations[0, 1], [1, 2, 3])


def test_keys_of_almost_one_moment_count_as_one():
    clip = read_clip(
        (2, "translation", [0, 1], [[1, 0, 0], [2, 0, 0]], "LINEAR"),
        (1, "translation", [0, 1.000001], [[0, 0, 0], [1, 0, 0]], "LINEAR"),
    )
    assert len(clip.times) == 2


def test_oddities_are_announced(caplog):
    made = made_arm()
    track = (2, "rotation", [0, 1], [[0, 0, 0, 2], [0, 0, 1, 1]], "LINEAR")
    made.clip("odd", track, track)
    made.clip("early", (2, "translation", [-1, 1], [[1, 0, 0], [2, 0, 0]], "LINEAR"))
    made.json["animations"][1]["channels"].append({"sampler": 0, "target": {"path": "colour"}})
    character = read_character("arm.glb", made.glb())
    assert [clip.name for clip in character.clips] == ["bend", "odd", "early"]
    for part in ("another channel moves already", "not unit", "before 0", "unknown path 'colour'"):
        assert part in caplog.text


@pytest.mark.parametrize(
    ("track", "message"),
    [
        ((2, "rotation", [0, 1], [[0, 0, 0, 1]], "LINEAR"), "1 values for 2 key times"),
        ((2, "scale", [0, 1], np.ones((2, 3)), "CUBICSPLINE"), "2 values for 2 key times"),
        ((2, "scale", [1, 0], np.ones((2, 3)), "LINEAR"), "numbers that rise"),
        ((2, "scale", [0, 1e30], np.ones((2, 3)), "LINEAR"), "key time 1e\\+30 s"),
        ((2, "scale", [0, 1], np.full((2, 3), np.nan), "LINEAR"), "NaN or infinite"),
        ((2, "rotation", [0, 1], np.zeros((2, 4)), "LINEAR"), "zero quaternion"),
        ((2, "scale", [0, 9e5], [[1, 1, 1], [2, 2, 2]], "STEP"), "too long to sample"),
    ],
)
def test_damaged_clips_are_refused(track, message):
    with pytest.raises(FormatError, match=message) as caught:
        read_clip(track)
    assert caught.value.where.startswith(("/accessors/", "/animations/0"))


def test_of_keys_at_one_time_the_last_counts(caplog):
    made = made_arm()
    values = np.array([[1.0, 1, 1], [2, 2, 2], [3, 3, 3]])
    made.clip("twice", (2, "scale", [0, 1, 1], values, "LINEAR"))
    clip = next(c for c in read_character("arm.glb", made.glb()).clips if c.name == "twice")
    assert clip.times.tolist() == [0, 1]
    assert np.allclose(clip.scales[:, 1], values[[0, 2]])
    assert "1 keys have the time of the next one" in caplog.text


def test_a_clip_without_channels_is_left_out(caplog):
    made = made_arm()
    made.json["animations"].append({"name": "nothing"})
    assert [clip.name for clip in read_character("arm.glb", made.glb()).clips] == ["bend"]
    assert "has no channels" in caplog.text

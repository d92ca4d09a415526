from dataclasses import replace

import numpy as np
import pytest

from bunraku import builtin
from bunraku.formats import read_motion
from bunraku.formats.bvh_writing import encode_bvh, plain_names
from bunraku.rotations import compose_transforms, vectors_to_matrices
from bunraku.skinning import clip_transforms, forward_kinematics, local_transforms
from bunraku.types import NO_PARENT, Clip, Skeleton


def follow(skeleton, clip):
    """Joints by name, and where each is in every frame."""
    places = forward_kinematics(skeleton.parents, clip_transforms(clip))[..., :3, 3]
    return {name: places[:, joint] for joint, name in enumerate(skeleton.names)}


def write_and_read(skeleton, clip, folder):
    path = folder / "motion.bvh"
    path.write_bytes(encode_bvh(skeleton, clip))
    return read_motion(path)


def test_two_joints_by_hand():
    rest = np.tile(np.eye(4), (2, 1, 1))
    rest[:, 1, 3] = 1.0
    turn = np.array([[0, 0, 0, 1.0], [0, 0, np.sqrt(0.5), np.sqrt(0.5)]])  # 90 degrees about Z
    clip = Clip("a", np.zeros(1), rest[None, :, :3, 3], turn[None], np.ones((1, 2, 3)))
    text = encode_bvh(Skeleton(("hips", "a b"), np.array([-1, 0]), rest), clip).decode()
    assert "ROOT hips\n{\n\tOFFSET 0 100 0\n\tCHANNELS 6 Xposition" in text
    assert "\tJOINT a_b\n\t{\n\t\tOFFSET 0 100 0\n\t\tCHANNELS 3 Zrotation" in text
    assert text.count("{") == text.count("}") == 3
    numbers = [float(word) for word in text.splitlines()[-1].split()]
    np.testing.assert_allclose(numbers, [0, 100, 0, 0, 0, 0, 90, 0, 0], atol=1e-9)


@pytest.mark.parametrize("name", ["walk", "kick", "turn"])
def test_the_humans_clips_come_back(name, tmp_path):
    human = builtin.human()
    clip = next(clip for clip in human.clips if clip.name == name)
    skeleton, read = write_and_read(human.skeleton, clip, tmp_path)
    ours, theirs = follow(human.skeleton, clip), follow(skeleton, read)
    for joint, places in ours.items():
        np.testing.assert_allclose(theirs[joint], places, atol=1e-4)
    np.testing.assert_allclose(read.times, clip.times, atol=1e-5)


def made_skeleton(rng, *, roots=1):
    """Eight joints with turned rest frames, a person's size."""
    joints = 8
    parents = np.array([NO_PARENT] * roots + [rng.integers(0, j) for j in range(roots, joints)])
    places = np.arange(1, joints + 1)[:, None] * (0.05, 0.25, 0.05)  # upright, as people stand
    world = compose_transforms(places, vectors_to_matrices(rng.normal(size=(joints, 3))))
    rest = local_transforms(parents, world)
    return Skeleton(tuple(f"joint {j}" for j in range(joints)), parents, rest)


def made_clip(skeleton, rng, *, stretch=0.0):
    frames, joints = 5, len(skeleton.names)
    rotations = rng.normal(size=(frames, joints, 4))
    rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
    translations = np.tile(skeleton.rest[:, :3, 3], (frames, 1, 1))
    translations[:, 0] += rng.normal(size=(frames, 3))
    translations += stretch * rng.normal(size=translations.shape)
    times = np.arange(frames) * 0.04
    return Clip("random", times, translations, rotations, np.ones((frames, joints, 3)))


@pytest.mark.parametrize(("roots", "stretch"), [(1, 0.0), (1, 0.3), (3, 0.2)])
def test_turned_rest_frames_stretched_bones_and_many_roots_come_back(rng, tmp_path, roots, stretch):
    skeleton = made_skeleton(rng, roots=roots)
    clip = made_clip(skeleton, rng, stretch=stretch)
    read_skeleton, read = write_and_read(skeleton, clip, tmp_path)
    ours, theirs = follow(skeleton, clip), follow(read_skeleton, read)
    scale = np.linalg.norm(theirs["joint_0"][0]) / np.linalg.norm(ours["joint 0"][0])
    assert min(abs(np.log10(scale)) % 1, 1 - abs(np.log10(scale)) % 1) < 1e-3  # the unit is guessed
    for joint, places in ours.items():
        found = theirs[joint.replace(" ", "_")] / scale
        np.testing.assert_allclose(found, places, atol=2e-3)


def test_uneven_frames_are_spaced_evenly(tmp_path):
    human = builtin.human()
    clip = next(clip for clip in human.clips if clip.name == "walk")
    kept = np.flatnonzero(np.arange(len(clip.times)) % 3 != 1)
    uneven = replace(
        clip,
        times=clip.times[kept],
        translations=clip.translations[kept],
        rotations=clip.rotations[kept],
        scales=clip.scales[kept],
    )
    skeleton, read = write_and_read(human.skeleton, uneven, tmp_path)
    assert len(read.times) == len(kept)
    assert np.ptp(np.diff(read.times)) < 1e-6
    assert read.times[-1] == pytest.approx(uneven.times[-1], abs=1e-4)
    last = follow(skeleton, read)["leftHand"][-1]
    np.testing.assert_allclose(last, follow(human.skeleton, clip)["leftHand"][kept[-1]], atol=1e-3)


def test_names_are_plain_and_differ():
    assert plain_names(("a b", "a_b", "", "{x}")) == ["a_b", "a_b_2", "joint", "_x_"]

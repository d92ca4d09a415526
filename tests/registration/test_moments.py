from dataclasses import replace

import numpy as np

from bunraku.registration.moments import look_at_clips
from bunraku.skinning import clip_transforms, forward_kinematics


def test_moments_are_world_turns_of_frames_of_the_clips(creature, body):
    clip, skeleton = creature.clips[0], creature.skeleton
    at_rest = forward_kinematics(skeleton.parents, skeleton.rest)[:, :3, :3]
    frames = forward_kinematics(skeleton.parents, clip_transforms(clip))[..., :3, :3]
    turns = frames @ np.swapaxes(at_rest, 1, 2)
    mass = np.ones(len(skeleton.names))
    moments = look_at_clips(creature, mass, count=3)
    chosen = moments.turns[moments.unlike]
    assert chosen.shape == (3, 7, 3, 3)
    apart = np.abs(chosen[:, None] - turns[None]).max(axis=(2, 3, 4))
    assert apart.min(axis=1).max() < 1e-9  # each is one of the frames
    assert len(set(apart.argmin(axis=1))) == 3
    places = forward_kinematics(skeleton.parents, clip_transforms(clip))[..., :3, 3]
    np.testing.assert_allclose(body.moments.places, places, atol=1e-12)  # few enough for all


def test_moments_differ_where_the_surface_does(creature):
    """Of an arm that moves no surface, no turn counts."""
    mass = np.ones(7)
    clip = creature.clips[0]
    rotations = np.tile(clip.rotations[:1], (8, 1, 1))
    rotations[5, 3] = [0.0, 0.0, 0.0, 1.0]
    rotations[2, 4] = [0.0, 0.0, 0.0, 1.0]
    source = replace(creature, clips=(replace(clip, rotations=rotations),))
    arms = [look_at_clips(source, mass * (np.arange(7) != still), count=2) for still in (3, 4)]
    for moments, moved in zip(arms, (4, 3), strict=True):
        first, other = moments.turns[moments.unlike]
        assert np.abs(first - other).max(axis=(1, 2)).argmax() == moved


def test_without_clips_there_are_no_moments(creature):
    moments = look_at_clips(replace(creature, clips=()), np.ones(7))
    assert moments.turns.shape == (0, 7, 3, 3) and not len(moments.unlike)

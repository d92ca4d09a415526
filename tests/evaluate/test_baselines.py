from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.evaluate.baselines import copy_by_name, fit_box, nearest_vertex, own_rig
from bunraku.evaluate.metrics import pose_distance
from bunraku.skinning import forward_kinematics, play_clip


def test_copying_a_clip_to_its_own_skeleton_changes_nothing(stick):
    clip = stick.clips[0]
    copied = copy_by_name(clip, stick.skeleton, stick.skeleton, 1.0)
    moved = play_clip(replace(stick, clips=(copied,)), copied)
    np.testing.assert_allclose(moved, play_clip(stick, clip), atol=1e-12)


def test_turns_since_rest_are_copied_between_other_rest_frames(stick):
    """The target's tip rests turned about X; it must bend about its own Z by the same angle."""
    rest = stick.skeleton.rest.copy()
    rest[1, :3, :3] = Rotation.from_rotvec([0.4, 0, 0]).as_matrix()
    tilted = replace(stick.skeleton, rest=rest)
    there = copy_by_name(stick.clips[0], stick.skeleton, tilted, 1.0)
    expected = Rotation.from_rotvec([0.4, 0, 0]) * Rotation.from_rotvec([0, 0, 1.0])
    np.testing.assert_allclose(
        Rotation.from_quat(there.rotations[-1, 1]).as_matrix(), expected.as_matrix(), atol=1e-9
    )
    back = copy_by_name(there, tilted, stick.skeleton, 1.0)
    np.testing.assert_allclose(np.abs(back.rotations), np.abs(stick.clips[0].rotations), atol=1e-9)


def test_the_own_rig_walks_as_far_as_its_size(stick, tall_stick):
    moved = own_rig(stick, tall_stick, stick.clips)
    np.testing.assert_allclose(np.ptp(moved.clips[0].translations[:, 0, 2]), 0.4)


def test_joints_the_source_lacks_keep_their_rest_pose(stick, tall_stick):
    renamed = replace(tall_stick.skeleton, names=("root", "other"))
    copied = copy_by_name(stick.clips[0], stick.skeleton, renamed, 2.0)
    np.testing.assert_array_equal(copied.rotations[:, 1], np.tile([0.0, 0, 0, 1], (9, 1)))


def test_fit_box_lays_one_box_over_another(rng):
    source, target = rng.normal(size=(20, 3)), 3 * rng.normal(size=(30, 3)) + 1
    laid = fit_box(source, source, target)
    np.testing.assert_allclose(laid.min(axis=0), target.min(axis=0))
    np.testing.assert_allclose(laid.max(axis=0), target.max(axis=0))


def test_nearest_vertex_is_right_for_the_same_body_in_another_size(stick):
    grown = replace(stick.mesh, vertices=2 * stick.mesh.vertices)
    found = nearest_vertex(stick, grown, stick.clips)
    np.testing.assert_allclose(found.skin.weights, stick.skin.weights)
    truth = 2 * play_clip(stick, stick.clips[0])
    assert pose_distance(play_clip(found, found.clips[0]), truth, 2.0) < 1e-9


def test_nearest_vertex_binds_its_skeleton_where_the_figure_stands(stick, tall_stick):
    found = nearest_vertex(stick, tall_stick.mesh, stick.clips)
    world = forward_kinematics(found.skeleton.parents, found.skeleton.rest)
    np.testing.assert_allclose(world @ found.skin.inverse_bind, np.tile(np.eye(4), (2, 1, 1)))
    assert world[1, 1, 3] == pytest.approx(1.0)

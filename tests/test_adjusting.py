from dataclasses import replace

import numpy as np
import pytest

from bunraku.adjusting import move_joint
from bunraku.rotations import vectors_to_matrices
from bunraku.skinning import (
    clip_transforms,
    forward_kinematics,
    linear_blend_skinning,
    play_clip,
    pose_joints,
)
from bunraku.types import Character, Mesh, Skin


@pytest.fixture
def tube(arm):
    """A tube about the joints of the arm, at x = 0, 1 and 2; the elbow bends it about x = 1."""
    along, around = np.meshgrid(np.linspace(-0.2, 2.4, 105), np.linspace(0, 2 * np.pi, 13)[:-1])
    places = [along, 0.1 * np.cos(around), 0.1 * np.sin(around)]
    vertices = np.stack(places, axis=-1).reshape(-1, 3)
    rows, columns = along.shape
    first = np.arange(rows)[:, None] * columns + np.arange(columns - 1)
    below = (first + columns) % (rows * columns)
    faces = np.concatenate(
        [
            np.stack([first, below, first + 1], axis=-1).reshape(-1, 3),
            np.stack([first + 1, below, below + 1], axis=-1).reshape(-1, 3),
        ]
    )
    elbow = np.clip((vertices[:, 0] - 0.8) / 0.4, 0, 1)
    wrist = np.clip((vertices[:, 0] - 1.9) / 0.2, 0, 1)
    weights = np.stack([1 - elbow, elbow * (1 - wrist), elbow * wrist], axis=1)
    rest = forward_kinematics(arm.parents, arm.rest)
    return Character(Mesh(vertices, faces), arm, Skin(weights, np.linalg.inv(rest)))


def crossing(character, joint):
    """Where along the tube a joint's weight first passes a half."""
    x, weight = character.mesh.vertices[:, 0], character.skin.weights[:, joint:].sum(axis=1)
    return x[weight >= 0.5].min()


@pytest.mark.parametrize("shift", [0.25, -0.2])
def test_the_skin_goes_with_the_joint(tube, shift):
    moved = move_joint(tube, 1, np.array([1.0 + shift, 0, 0]))
    assert crossing(tube, 1) == pytest.approx(1.0, abs=0.03)
    assert crossing(moved, 1) == pytest.approx(1.0 + shift, abs=0.03)
    assert crossing(moved, 2) == pytest.approx(crossing(tube, 2), abs=0.03)
    np.testing.assert_allclose(moved.skin.weights.sum(axis=1), 1, atol=1e-9)
    places = forward_kinematics(moved.skeleton.parents, moved.skeleton.rest)[:, :3, 3]
    np.testing.assert_allclose(places, [(0, 0, 0), (1 + shift, 0, 0), (2, 0, 0)], atol=1e-12)


def test_the_figure_bends_about_the_new_place(tube):
    """What lies wholly beyond the joint turns rigidly about where the joint now is."""
    moved = move_joint(tube, 1, np.array([1.25, 0, 0]))
    turns = vectors_to_matrices(np.array([[0, 0, 0], [0, 0, 0.7], [0, 0, 0.0]]))
    world = forward_kinematics(moved.skeleton.parents, pose_joints(moved.skeleton.rest, turns))
    vertices = tube.mesh.vertices
    posed = linear_blend_skinning(vertices, moved.skin.weights, world @ moved.skin.inverse_bind)
    beyond = moved.skin.weights[:, 1:].sum(axis=1) > 1 - 1e-9
    assert 0.2 < beyond.mean() < 0.6
    expected = (vertices - (1.25, 0, 0)) @ turns[1].T + (1.25, 0, 0)
    np.testing.assert_allclose(posed[beyond], expected[beyond], atol=1e-9)


def test_a_joint_that_stays_changes_nothing(creature):
    bound = np.linalg.inv(creature.skin.inverse_bind)
    same = move_joint(creature, 3, bound[3, :3, 3])
    np.testing.assert_allclose(same.skin.weights, creature.skin.weights, atol=1e-9)
    clip = creature.clips[0]
    np.testing.assert_allclose(play_clip(same, same.clips[0]), play_clip(creature, clip), atol=1e-9)


def test_other_joints_stay_in_place_at_rest_and_turn_as_before(creature):
    bound = np.linalg.inv(creature.skin.inverse_bind)
    moved = move_joint(creature, 2, bound[2, :3, 3] + (0.02, -0.05, 0.01))
    after = np.linalg.inv(moved.skin.inverse_bind)
    shifts = np.linalg.norm(after[:, :3, 3] - bound[:, :3, 3], axis=1)
    assert np.flatnonzero(shifts > 1e-9).tolist() == [2]
    np.testing.assert_array_equal(moved.clips[0].rotations, creature.clips[0].rotations)
    world = forward_kinematics(moved.skeleton.parents, clip_transforms(moved.clips[0]))
    assert np.isfinite(world).all()


def test_there_and_back_is_where_it_was(tube):
    there = move_joint(tube, 1, np.array([1.1, 0, 0]))
    back = move_joint(there, 1, np.array([1.0, 0, 0]))
    assert np.abs(back.skin.weights - tube.skin.weights).max() < 0.1
    np.testing.assert_allclose(back.skin.inverse_bind, tube.skin.inverse_bind, atol=1e-12)


def test_points_without_faces_move_too(tube):
    cloud = replace(tube, mesh=Mesh(tube.mesh.vertices, np.zeros((0, 3), np.int64)))
    moved = move_joint(cloud, 1, np.array([1.25, 0, 0]))
    assert crossing(moved, 1) == pytest.approx(1.25, abs=0.05)


def test_the_last_joint_takes_all_beyond_it(tube):
    moved = move_joint(tube, 2, np.array([2.2, 0, 0]))
    assert crossing(moved, 2) == pytest.approx(2.2, abs=0.04)

import numpy as np
import pytest
from jaxtyping import TypeCheckError
from scipy.spatial.transform import Rotation

from bunraku.skinning import (
    clip_transforms,
    forward_kinematics,
    keep_influences,
    linear_blend_skinning,
    local_transforms,
    play_clip,
    pose_joints,
)


def random_rotations(rng, *shape):
    return Rotation.random(int(np.prod(shape)), rng=rng).as_matrix().reshape(*shape, 3, 3)


def test_bending_the_elbow_lifts_the_wrist(arm):
    """A case small enough to work out by hand."""
    rotations = np.tile(np.eye(3), (3, 1, 1))
    rotations[1] = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    world = forward_kinematics(arm.parents, pose_joints(arm.rest, rotations))
    np.testing.assert_allclose(world[:, :3, 3], [[0, 0, 0], [1, 0, 0], [1, 1, 0]], atol=1e-12)


def test_rest_pose_leaves_the_mesh_alone(arm, arm_skin, rng):
    vertices = rng.normal(size=(7, 3))
    motion = forward_kinematics(arm.parents, arm.rest) @ arm_skin.inverse_bind
    np.testing.assert_allclose(linear_blend_skinning(vertices, arm_skin.weights, motion), vertices)


def test_moving_all_joints_rigidly_moves_the_mesh_rigidly(arm_skin, rng):
    vertices, move = rng.normal(size=(7, 3)), np.eye(4)
    move[:3, :3], move[:3, 3] = random_rotations(rng, 1)[0], [1.0, 2.0, 3.0]
    moved = linear_blend_skinning(vertices, arm_skin.weights, np.tile(move, (3, 1, 1)))
    np.testing.assert_allclose(moved, vertices @ move[:3, :3].T + move[:3, 3])


def test_local_transforms_undo_forward_kinematics(arm, rng):
    local = pose_joints(arm.rest, random_rotations(rng, 5, 3))
    local[..., :3, :3] *= rng.uniform(0.5, 2.0, (5, 3, 1, 3))
    world = forward_kinematics(arm.parents, local)
    np.testing.assert_allclose(local_transforms(arm.parents, world), local, atol=1e-9)


def test_agrees_with_the_sum_in_the_paper(arm, arm_skin, rng):
    """Eq. 6 written out term by term."""
    vertices = rng.normal(size=(7, 3))
    world = forward_kinematics(arm.parents, pose_joints(arm.rest, random_rotations(rng, 5, 3)))
    motion = world @ arm_skin.inverse_bind
    moved = linear_blend_skinning(vertices, arm_skin.weights, motion)
    for t, v in np.ndindex(5, 7):
        point = np.append(vertices[v], 1.0)
        expected = sum(arm_skin.weights[v, j] * (motion[t, j] @ point) for j in range(3))
        np.testing.assert_allclose(moved[t, v], expected[:3])


def test_each_joint_inherits_the_motion_of_all_its_ancestors(arm, rng):
    local = pose_joints(arm.rest, random_rotations(rng, 5, 3))
    world = forward_kinematics(arm.parents, local)
    np.testing.assert_allclose(world[:, 2], local[:, 0] @ local[:, 1] @ local[:, 2])


def test_every_root_starts_its_own_tree(arm, rng):
    local = pose_joints(arm.rest, random_rotations(rng, 3))
    world = forward_kinematics(np.array([-1, -1, 1]), local)
    np.testing.assert_array_equal(world[:2], local[:2])


def test_a_clip_plays_frame_by_frame(creature):
    """Against Eqs. 4-6 for one vertex and frame at a time."""
    clip, skin = creature.clips[0], creature.skin
    played, local = play_clip(creature, clip), clip_transforms(clip)
    for frame, vertex in [(0, 0), (3, 100), (7, 2000)]:
        world: list[np.ndarray] = []
        for joint, parent in enumerate(creature.skeleton.parents):
            above = np.eye(4) if parent < 0 else world[parent]
            world.append(above @ local[frame, joint])
        point = np.append(creature.mesh.vertices[vertex], 1.0)
        blended = sum(
            weight * (to_world @ inverse_bind @ point)
            for weight, to_world, inverse_bind in zip(
                skin.weights[vertex], world, skin.inverse_bind, strict=True
            )
        )
        np.testing.assert_allclose(played[frame, vertex], blended[:3], atol=1e-9)


def test_chosen_frames_of_a_clip_are_those_of_the_whole(creature):
    clip = creature.clips[0]
    chosen = slice(1, None, 3)
    np.testing.assert_array_equal(
        play_clip(creature, clip, chosen), play_clip(creature, clip)[chosen]
    )


def test_keep_influences_drops_the_smallest(rng):
    weights = rng.random((50, 300))
    kept = keep_influences(weights, count=4)
    np.testing.assert_allclose(kept.sum(axis=1), 1.0)
    fourth_largest = np.sort(weights, axis=1)[:, -4, None]
    np.testing.assert_array_equal(kept > 0, weights >= fourth_largest)


def test_keep_influences_leaves_few_joints_as_they_are(rng):
    weights = rng.dirichlet(np.ones(3), size=9)
    np.testing.assert_allclose(keep_influences(weights, count=4), weights)


def test_keep_influences_drops_negative_weights():
    np.testing.assert_array_equal(keep_influences(np.array([[1.5, -0.5]])), [[1.0, 0.0]])


def test_keep_influences_names_a_vertex_that_nothing_moves():
    with pytest.raises(ValueError, match="vertex 1 has no positive skinning weight"):
        keep_influences(np.array([[1.0, 0.0], [0.0, -1.0]]))


def test_shapes_are_checked_while_testing(arm_skin, rng):
    six_vertices = rng.normal(size=(6, 3))
    with pytest.raises(TypeCheckError):
        linear_blend_skinning(six_vertices, arm_skin.weights, np.tile(np.eye(4), (3, 1, 1)))

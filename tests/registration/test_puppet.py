from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.graphs import descendants
from bunraku.meshes import vertex_normals
from bunraku.registration.puppet import (
    Pose,
    Puppet,
    bone_axes,
    make_puppet,
    move_puppet,
    place_anchors,
    rest_pose,
    step_pose,
    stretches,
    tree_of_places,
)
from bunraku.rotations import compose_transforms
from bunraku.skinning import forward_kinematics, linear_blend_skinning
from tests.creatures import NAMES, PARENTS

QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # a quarter turn about Z


@pytest.fixture
def rod() -> Puppet:
    """Three vertices on two bones along X: the root's, the middle at the elbow, the tip's."""
    return Puppet(
        vertices=np.array([[0.5, 0.1, 0], [1.0, 0, 0], [2.0, 0, 0]]),
        faces=np.array([[0, 1, 2]]),
        weights=np.array([[1.0, 0], [0.5, 0.5], [0, 1.0]]),
        anchors=np.array([[0.0, 0, 0], [1, 0, 0]]),
        parents=np.array([-1, 0]),
        axes=np.array([[1.0, 0, 0], [1, 0, 0]]),
        joints=np.array([0, 1]),
        samples=np.array([0, 1, 2]),
        stiffness=np.tile(np.eye(3), (2, 1, 1)),
        owners=np.array([0, 1]),
    )


def lend_to(puppet: Puppet, names: list[str]) -> list[int]:
    """Give the puppet's numbers of the creature's joints."""
    return [int(np.flatnonzero(puppet.joints == NAMES.index(name))[0]) for name in names]


def test_stretch_along_an_axis_and_across_it():
    scales = np.log([[2.0, 3.0], [2.0, 3.0]])
    along_y, without_axis = stretches(np.array([[0.0, 1, 0], [0, 0, 0]]), scales)
    np.testing.assert_allclose(along_y, np.diag([3.0, 2, 3]), atol=1e-15)
    np.testing.assert_allclose(without_axis, 3 * np.eye(3), atol=1e-15)


def test_a_bent_and_stretched_rod_by_hand(rod):
    scales = np.log([[2.0, 3.0], [1.0, 1.0]])
    pose = Pose(np.array([0.0, 0, 5]), np.stack([np.eye(3), QUARTER]), scales)
    moved, normals = move_puppet(rod, pose)
    # the first bone is twice as long and thrice as thick; the elbow, at x = 2, is bent upwards
    np.testing.assert_allclose(moved, [[1.0, 0.3, 5], [2, 0, 5], [2, 1, 5]], atol=1e-12)
    np.testing.assert_allclose(normals, rod.normals, atol=1e-12)  # bent in their own plane


def test_rest_pose_leaves_the_puppet_alone(puppet):
    moved, normals = move_puppet(puppet, rest_pose(puppet))
    np.testing.assert_allclose(moved, puppet.vertices, atol=1e-12)
    np.testing.assert_allclose(normals, puppet.normals, atol=1e-12)


def test_a_heading_turns_the_whole_puppet_about_the_origin(puppet):
    moved, normals = move_puppet(puppet, rest_pose(puppet, QUARTER))
    np.testing.assert_allclose(moved, puppet.vertices @ QUARTER.T, atol=1e-12)
    np.testing.assert_allclose(normals, puppet.normals @ QUARTER.T, atol=1e-12)


def test_chosen_vertices_move_as_they_do_with_the_others(puppet, somehow):
    for part, whole in zip(
        move_puppet(puppet, somehow, puppet.samples[:50]), move_puppet(puppet, somehow), strict=True
    ):
        np.testing.assert_allclose(part, whole[puppet.samples[:50]], atol=1e-12)


def test_without_scales_a_puppet_moves_by_skinning(puppet, somehow):
    """Against forward kinematics and linear blend skinning of the same joints."""
    pose = replace(somehow, scales=np.zeros_like(somehow.scales))
    above = np.vstack([np.zeros(3), puppet.anchors])[puppet.parents + 1]
    offsets = puppet.anchors - above
    offsets[0] = pose.root
    world = forward_kinematics(puppet.parents, compose_transforms(offsets, pose.rotations))
    back = np.tile(np.eye(4), (len(NAMES), 1, 1))
    back[:, :3, 3] = -puppet.anchors
    expected = linear_blend_skinning(puppet.vertices, puppet.weights, world @ back)
    np.testing.assert_allclose(move_puppet(puppet, pose)[0], expected, atol=1e-12)


def test_scales_and_turns_agree_with_a_walk_up_the_tree(puppet, somehow):
    """A bone stretches its own surface and moves its children's anchors, but not their surface."""

    def stretched(joint: int, offset: np.ndarray) -> np.ndarray:
        on_axis = (offset @ puppet.axes[joint]) * puppet.axes[joint]
        along, across = np.exp(somehow.scales[joint])
        return along * on_axis + across * (offset - on_axis)

    moved, _ = move_puppet(puppet, somehow)
    for vertex in (0, 700, 2500):
        total = np.zeros(3)
        for owner, weight in enumerate(puppet.weights[vertex]):
            joint, parent = owner, int(puppet.parents[owner])
            bone = stretched(joint, puppet.vertices[vertex] - puppet.anchors[joint])
            offset = somehow.rotations[joint] @ bone
            while parent >= 0:
                bone = stretched(parent, puppet.anchors[joint] - puppet.anchors[parent])
                offset = somehow.rotations[parent] @ (bone + offset)
                joint, parent = parent, int(puppet.parents[parent])
            total += weight * (somehow.root + offset)
        np.testing.assert_allclose(moved[vertex], total, atol=1e-12)


def test_a_step_turns_everything_below_a_joint_about_its_anchor(puppet, somehow):
    chest = lend_to(puppet, ["chest"])[0]
    turn = np.array([0.3, -0.2, 0.5])
    turns = np.zeros_like(puppet.anchors)
    turns[chest] = turn
    stepped = step_pose(puppet, somehow, turns, np.zeros_like(somehow.scales), np.zeros(3))
    before, after = somehow.world(puppet), stepped.world(puppet)
    matrix = Rotation.from_rotvec(turn).as_matrix()
    below = descendants(puppet.parents)[chest]
    np.testing.assert_allclose(after[0][below], matrix @ before[0][below], atol=1e-12)
    np.testing.assert_allclose(after[0][~below], before[0][~below], atol=1e-12)
    centre = before[2][chest]
    expected = (before[2][below] - centre) @ matrix.T + centre
    np.testing.assert_allclose(after[2][below], expected, atol=1e-12)


def test_a_step_adds_scales_and_moves_the_root(puppet, somehow, rng):
    scales, shift = rng.normal(size=somehow.scales.shape), rng.normal(size=3)
    stepped = step_pose(puppet, somehow, np.zeros_like(puppet.anchors), scales, shift)
    np.testing.assert_allclose(stepped.rotations, somehow.rotations, atol=1e-12)
    np.testing.assert_allclose(stepped.scales, somehow.scales + scales)
    np.testing.assert_allclose(stepped.root, somehow.root + shift)


def split_legs(creature) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cut feet off the legs and hang them off the hips, as rigs with inverse kinematics do."""
    vertices, weights = creature.mesh.vertices, creature.skin.weights
    foot = np.clip((0.14 - vertices[:, 1:2]) / 0.04, 0, 1)
    feet = weights[:, 5:] * foot
    weights = np.hstack([weights[:, :5], weights[:, 5:] - feet, feet])
    joints = forward_kinematics(PARENTS, creature.skeleton.rest)[:, :3, 3]
    joints = np.vstack([joints, [[0.12, 0.1, 0], [-0.12, 0.1, 0]]])
    return weights, joints, np.append(PARENTS, [0, 0])


def test_a_foot_that_hangs_off_the_root_goes_with_its_leg(creature):
    weights, joints, parents = split_legs(creature)
    puppet = make_puppet(creature.mesh.vertices, creature.mesh.faces, weights, joints, parents)
    number = {int(joint): i for i, joint in enumerate(puppet.joints)}
    for foot, leg in ((7, 5), (8, 6)):
        assert puppet.joints[puppet.parents[number[foot]]] == leg
        # it turns where it meets the leg, not about the joint of the rig
        anchor = puppet.anchors[number[foot]]
        assert 0.09 < anchor[1] < 0.15 and abs(anchor[0] - joints[leg, 0]) < 0.06
    np.testing.assert_array_equal(tree_of_places(puppet, parents)[7:], [5, 6])
    np.testing.assert_array_equal(tree_of_places(puppet, parents)[:7], PARENTS)


def test_places_of_an_ordinary_rig_follow_its_own_parents(puppet):
    np.testing.assert_array_equal(tree_of_places(puppet, PARENTS), PARENTS)


def test_anchors_by_hand():
    """The joint itself, its former child, or the middle of the surface it shares."""
    vertices, areas = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.ones(3)
    weights = np.array([[1.0, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 0.25, 0.25, 0.5]])
    joints = np.array([[0.0, 9, 0], [1, 9, 0], [2, 9, 0], [3, 9, 0]])
    tree = np.array([-1, 0, 1, 2])
    hierarchy = np.zeros((4, 4), bool)
    hierarchy[0, 1] = hierarchy[3, 2] = hierarchy[3, 0] = True  # joint 3 was above 2 and 0
    anchors = place_anchors(vertices, areas, weights, joints, tree, hierarchy)
    np.testing.assert_allclose(anchors, [joints[0], joints[1], [2, 0, 0], joints[2]])


def test_axes_point_at_an_only_child_or_at_the_surface(puppet):
    hips, chest, arm, leg = lend_to(puppet, ["hips", "chest", "leftArm", "leftLeg"])
    assert not puppet.axes[hips].any() and not puppet.axes[chest].any()  # they branch
    np.testing.assert_allclose(puppet.axes[arm], [0.82, -0.57, 0], atol=0.05)
    assert puppet.axes[leg][1] < -0.9
    np.testing.assert_allclose(np.linalg.norm(puppet.axes[2:], axis=1), 1)


def test_a_bone_without_length_has_no_axis():
    axes = bone_axes(
        np.zeros((1, 3)), np.ones(1), np.ones((1, 1)), np.zeros((1, 3)), np.array([-1])
    )
    np.testing.assert_array_equal(axes, 0)


def test_the_creature_becomes_a_puppet_with_its_own_joints(creature, puppet):
    np.testing.assert_array_equal(puppet.joints[puppet.parents[1:]], PARENTS[puppet.joints[1:]])
    np.testing.assert_allclose(puppet.weights, creature.skin.weights[:, puppet.joints])
    assert np.isclose(puppet.areas.sum(), 1.0)
    np.testing.assert_array_equal(puppet.below, descendants(puppet.parents))
    np.testing.assert_array_equal(
        np.argwhere(puppet.children)[:, 0], np.sort(puppet.parents[puppet.parents >= 0])
    )
    np.testing.assert_allclose(puppet.normals, vertex_normals(puppet.vertices, puppet.faces))


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("parent", [-1, 0])
def test_a_joint_that_moves_nothing_takes_no_part(creature, puppet, first, parent):
    """Wherever it is stored, and whether it is a root or not."""
    if first and parent == 0:
        parents = np.append(-1, PARENTS + 1)  # a floor root above the hips
    elif first:
        parents = np.append(-1, np.where(PARENTS < 0, -1, PARENTS + 1))
    else:
        parents = np.append(PARENTS, parent)
    joints = forward_kinematics(PARENTS, creature.skeleton.rest)[:, :3, 3]
    place = 0 if first else 7
    other = make_puppet(
        *(creature.mesh.vertices, creature.mesh.faces),
        np.insert(creature.skin.weights, place, 0.0, axis=1),
        np.insert(joints, place, [0.0, -0.2, 0.1], axis=0),
        parents,
    )
    np.testing.assert_array_equal(other.joints - first, puppet.joints)
    np.testing.assert_array_equal(other.parents, puppet.parents)
    assert np.isfinite(other.axes).all()


def test_a_rig_of_several_roots_becomes_one_tree(creature):
    joints = forward_kinematics(PARENTS, creature.skeleton.rest)[:, :3, 3]
    surface = creature.mesh.vertices, creature.mesh.faces, creature.skin.weights
    puppet = make_puppet(*surface, joints, np.full(7, -1))
    assert (puppet.parents[1:] >= 0).all() and puppet.parents[0] == -1


def test_a_rig_of_one_joint_is_a_puppet(creature):
    surface = creature.mesh.vertices, creature.mesh.faces
    puppet = make_puppet(*surface, np.ones((len(surface[0]), 1)), np.zeros((1, 3)), np.array([-1]))
    np.testing.assert_array_equal(puppet.parents, [-1])
    moved, _ = move_puppet(puppet, rest_pose(puppet))
    np.testing.assert_allclose(moved, puppet.vertices, atol=1e-12)


def test_a_small_joint_is_carried_by_the_joint_that_it_was_merged_into(rod):
    """A foot off the root, one off nothing: with the leg. A finger stays on its hand's chain."""
    merged = replace(rod, owners=np.array([0, 1, 1, 1, 1, 1]))
    parents = np.array([-1, 0, 0, -1, 1, 4])
    np.testing.assert_array_equal(tree_of_places(merged, parents), [-1, 0, 1, 1, 1, 4])

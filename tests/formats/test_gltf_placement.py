import numpy as np
import pytest

from bunraku.formats.gltf.placement import agree_on_placement
from bunraku.rotations import compose_transforms, vectors_to_matrices

POINTS = np.array([[0.0, 0, 0], [0, 1, 0], [0, 2, 0], [1, 2, 0]])
MASS = np.array([3.0, 3.0, 2.0, 2.0])
Z_UP = vectors_to_matrices(np.array([-np.pi / 2, 0.0, 0.0]))


def place(rotation=Z_UP, scale=100.0, offset=(0.0, 0.0, 0.0)):
    return compose_transforms(np.array(offset, float), rotation, np.full(3, scale))


def bend(placement, degrees, point, axis=(0.0, 0.0, 1.0)):
    """Turn a placement in world space about where it puts a point."""
    pivot = placement[:3, :3] @ point + placement[:3, 3]
    turn = vectors_to_matrices(np.radians(degrees) * np.array(axis))
    return compose_transforms(pivot - turn @ pivot, turn) @ placement


def test_joints_that_agree_are_believed_to_the_digit():
    odd = place(vectors_to_matrices(np.array([0.1, 0.2, 0.3])), 1.5, (1, 2, 3))
    found = agree_on_placement(np.tile(odd, (4, 1, 1)), MASS, POINTS, recorded=place())
    np.testing.assert_array_equal(found, odd)


def test_most_of_the_mass_decides_when_an_arm_hangs_down():
    true = place(offset=(0, 5, 0))
    opinions = np.stack([true, true, true, bend(true, 70, POINTS[2])])
    np.testing.assert_allclose(agree_on_placement(opinions, MASS, POINTS), true, atol=1e-9)


def test_a_slight_lean_is_put_upright():
    true = place()
    opinions = np.stack([bend(true, 3, POINTS[0])] * 3 + [bend(true, 70, POINTS[2])])
    found = agree_on_placement(opinions, MASS, POINTS)
    np.testing.assert_allclose(found[:3, :3], true[:3, :3], atol=1e-9)


@pytest.mark.parametrize("angles", [(40, 80, 120, 20), (30, 30, 30, 60)])
def test_the_nodes_own_transform_is_believed_in_any_pose(angles):
    true = place(offset=(0, 5, 0))
    turned = [bend(true, a, p) for a, p in zip(angles, POINTS, strict=True)]
    found = agree_on_placement(np.stack(turned), MASS, POINTS, recorded=true)
    np.testing.assert_array_equal(found, true)


def test_a_transform_of_another_scale_is_no_witness():
    true = place()
    opinions = np.stack([true, true, true, bend(true, 70, POINTS[2])])
    found = agree_on_placement(opinions, MASS, POINTS, recorded=np.eye(4))
    np.testing.assert_allclose(found, true, atol=1e-9)


def test_joints_that_are_a_quarter_turned_outvote_the_node():
    true = place(scale=1.0)
    opinions = np.stack([true, true, true, bend(true, 70, POINTS[2])])
    found = agree_on_placement(opinions, MASS, POINTS, recorded=np.eye(4))
    np.testing.assert_allclose(found, true, atol=1e-9)


def test_a_clear_heading_of_the_joints_turns_the_placement():
    """A figure stored facing +X whose clips and nodes face +Z."""
    stored = place()
    facing = bend(stored, -90, POINTS[0], axis=(0.0, 1.0, 0.0))
    angles = (20, -20, 25, -25)
    turned = [bend(facing, a, p) for a, p in zip(angles, POINTS, strict=True)]
    found = agree_on_placement(np.stack(turned), MASS, POINTS, recorded=stored)
    np.testing.assert_allclose(found, facing, atol=1e-9)


def test_a_rig_without_weights_counts_every_joint_alike():
    true = place()
    opinions = np.stack([bend(true, 70, POINTS[2]), true, true, true])
    found = agree_on_placement(opinions, np.zeros(4), POINTS)
    np.testing.assert_allclose(found, true, atol=1e-9)

import numpy as np
import pytest

from bunraku.meshes import vertex_areas
from bunraku.registration.joint_tree import (
    is_parent_of,
    join_by_shared_surface,
    merge_small_joints,
    pairs_that_hold,
)
from tests.creatures import NAMES, PARENTS

WHOLE_HAND = np.array([-1, 0, 1, 2, 3, 3, 3])  # floor > hips > arm > hand > three fingers


def test_fingers_merge_into_the_hand_and_a_floor_root_into_the_hips():
    mass = np.array([0.0, 5.0, 3.0, 0.3, 0.25, 0.25, 0.25])
    np.testing.assert_array_equal(merge_small_joints(mass, WHOLE_HAND, 1.0), [1, 1, 2, 3, 3, 3, 3])


def test_a_hand_that_is_small_with_its_fingers_merges_into_the_arm():
    mass = np.array([0.0, 5.0, 3.0, 0.3, 0.1, 0.1, 0.1])
    np.testing.assert_array_equal(merge_small_joints(mass, WHOLE_HAND, 1.0), [1, 1, 2, 2, 2, 2, 2])


def test_a_small_root_goes_to_its_heavier_child_and_a_lone_one_to_the_heaviest_joint():
    parents, mass = np.array([-1, -1, 1, 1]), np.array([0.0, 0.0, 2.0, 3.0])
    np.testing.assert_array_equal(merge_small_joints(mass, parents, 1.0), [3, 3, 2, 3])


def test_a_small_root_goes_where_most_of_the_body_hangs():
    """A heavy foot that an IK rig hangs off the floor is no match for the whole body."""
    parents, mass = np.array([-1, 0, 0, 2, 3]), np.array([0.0, 4.0, 1.5, 3.0, 3.0])
    np.testing.assert_array_equal(merge_small_joints(mass, parents, 1.0), [2, 1, 2, 3, 4])


def test_a_small_root_sees_the_body_below_a_pelvis_without_surface():
    parents, mass = np.array([-1, 0, 0, 2, 3]), np.array([0.0, 0.1, 0.0, 0.6, 0.3])
    np.testing.assert_array_equal(merge_small_joints(mass, parents, 0.004), [3, 1, 3, 3, 4])


def test_an_origin_on_the_floor_that_holds_one_hoof_merges_into_the_body_and_hips_do_not():
    parents = np.array([-1, 0, 0, 1, 1])
    floor, hips = np.array([1.0, 50, 1, 24, 24]), np.array([1.0, 50, 49, 0, 0])
    np.testing.assert_array_equal(merge_small_joints(floor, parents, 0.4), [1, 1, 2, 3, 4])
    np.testing.assert_array_equal(merge_small_joints(hips[:3], parents[:3], 0.4), [0, 1, 2])


def test_merging_leaves_joints_that_carry_enough_alone(creature, rng):
    mass = rng.uniform(1, 2, 7)
    np.testing.assert_array_equal(merge_small_joints(mass, PARENTS, 1.0), np.arange(7))
    np.testing.assert_array_equal(merge_small_joints(np.ones(1), np.array([-1]), 1.0), [0])


def shared_surface(count: int, *pairs: tuple[int, int]) -> np.ndarray:
    """Let pairs of joints share one unit of surface each."""
    shared = np.zeros((count, count))
    for one, other in pairs:
        shared[one, other] = shared[other, one] = 1.0
    return shared


def test_a_small_foot_that_hangs_off_the_floor_merges_into_the_leg_it_shares_surface_with():
    parents, mass = np.array([-1, 0, 1, 0, 0]), np.array([0.0, 6, 3, 0.2, 0.2])
    shared = shared_surface(5, (1, 2), (2, 3))  # floor > body > leg; a foot and a tag on the floor
    owner = merge_small_joints(mass, parents, 1.0, shared)
    np.testing.assert_array_equal(owner, [1, 1, 2, 2, 1])
    np.testing.assert_array_equal(merge_small_joints(mass, parents, 1.0), [1, 1, 2, 1, 1])


def test_a_small_foot_without_parent_merges_into_its_leg_as_well():
    parents, mass = np.array([-1, 0, -1]), np.array([6.0, 3, 0.2])
    owner = merge_small_joints(mass, parents, 1.0, shared_surface(3, (0, 1), (1, 2)))
    np.testing.assert_array_equal(owner, [0, 1, 1])


def test_a_small_joint_of_the_trunk_stays_with_its_parent():
    """What hangs below it is half the body: it must not go to a leg that it touches."""
    parents, mass = np.array([-1, 0, 1, 0]), np.array([3.0, 0.2, 3, 3])
    owner = merge_small_joints(mass, parents, 1.0, shared_surface(4, (1, 2), (1, 3)))
    np.testing.assert_array_equal(owner, [0, 0, 2, 3])


def test_strays_that_share_with_each_other_alone_find_an_owner():
    parents, mass = np.array([-1, 0, 0]), np.array([6.0, 0.2, 0.2])
    owner = merge_small_joints(mass, parents, 1.0, shared_surface(3, (1, 2)))
    np.testing.assert_array_equal(owner, [0, 0, 0])


def test_merged_joints_are_never_merged_further(rng):
    for _ in range(50):
        parents = np.array([rng.integers(-1, joint) if joint else -1 for joint in range(12)])
        mass = rng.exponential(size=12)
        shared = rng.exponential(size=(12, 12)) * (rng.uniform(size=(12, 12)) < 0.2)
        shared = (shared + shared.T) * (1 - np.eye(12))
        owner = merge_small_joints(mass, parents, 1.0, shared if rng.integers(2) else None)
        np.testing.assert_array_equal(owner[owner], owner)
        collected = np.bincount(owner, mass, 12)
        roots = parents == -1
        assert np.isclose(collected.sum(), mass.sum())
        assert (collected[(collected > 0) & ~roots] >= 1.0).all()


def test_parents_of_kept_joints_skip_the_merged_ones():
    parents, owner = np.array([-1, 0, 1, 2]), np.array([1, 1, 1, 3])
    hierarchy = is_parent_of(np.array([1, 3]), parents, owner)
    np.testing.assert_array_equal(hierarchy, [[False, True], [False, False]])


def test_an_ordinary_tree_is_kept(creature):
    areas = vertex_areas(creature.mesh.vertices, creature.mesh.faces)
    hierarchy = is_parent_of(np.arange(7), PARENTS, np.arange(7))
    order, tree = join_by_shared_surface(areas, creature.skin.weights, hierarchy)
    assert sorted(order) == list(range(7)) and order[0] == NAMES.index("hips")
    assert (tree < np.arange(7)).all()
    expected = PARENTS[order]
    found = np.where(tree < 0, -1, order[tree])
    np.testing.assert_array_equal(found, expected)


def test_the_tree_does_not_depend_on_the_order_of_siblings(creature, rng):
    shuffle = np.concatenate([[0, 1], 2 + rng.permutation(5)])
    parents = PARENTS[shuffle]  # the first two stay, so their numbers do
    weights = creature.skin.weights[:, shuffle]
    areas = vertex_areas(creature.mesh.vertices, creature.mesh.faces)
    hierarchy = is_parent_of(np.arange(7), parents, np.arange(7))
    order, tree = join_by_shared_surface(areas, weights, hierarchy)
    np.testing.assert_array_equal(np.where(tree < 0, -1, order[tree]), parents[order])


def test_the_tree_starts_at_the_top_with_the_most_surface_below_it():
    """Not at the heavier of two tops: a prop of its own weighs more than light hips alone."""
    hierarchy = np.zeros((4, 4), bool)
    hierarchy[1, 2] = hierarchy[2, 3] = True  # hips > chest > head, and the prop beside them
    weights = np.array([[1.0, 0, 0, 0], [0, 0.5, 0.5, 0], [0, 0, 0.5, 0.5], [0, 0, 0, 1]])
    order, tree = join_by_shared_surface(np.array([2.0, 0.5, 2, 2]), weights, hierarchy)
    assert order[0] == 1 and tree[0] == -1


@pytest.mark.parametrize(("contact", "parent"), [(1.0, 0), (5.0, 1)])
def test_only_much_more_shared_surface_changes_the_tree(contact, parent):
    """A thigh that touches the other more than its hips stays; a foot on its shin does not."""
    hierarchy = np.array([[False, True, True], [False] * 3, [False] * 3])
    weights = np.array([[0.9, 0.0, 0.1], [0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.0, 0.0, 1.0]])
    areas = np.array([1.0, 1.0, contact, 1.0])
    rest = np.array([[1.0, 0.0, 0.0]])  # of the body, beside which the limb is small
    surface = np.append(areas, 40.0), np.vstack([weights, rest])
    order, tree = join_by_shared_surface(*surface, hierarchy)
    assert order[tree[list(order).index(2)]] == parent
    order, tree = join_by_shared_surface(areas, weights, hierarchy)  # half a body is no stray
    assert order[tree[list(order).index(2)]] == 0


def test_a_rival_below_a_joint_is_none():
    """A shoulder shares little with the chest, and much with the arm that hangs on it."""
    chain = np.zeros((3, 3), bool)
    chain[0, 1] = chain[1, 2] = True  # chest > shoulder > arm
    shared = np.array([[0.0, 0.01, 0.02], [0.01, 0, 0.3], [0.02, 0.3, 0]])
    mass = np.array([10.0, 0.4, 0.6])
    np.testing.assert_array_equal(pairs_that_hold(shared, mass, chain), chain)
    beside = np.zeros((3, 3), bool)
    beside[0, 1] = beside[0, 2] = True  # a foot and a shin, both hung off the root
    held = pairs_that_hold(shared, mass, beside)
    assert not held.any()  # each shares more with the other


def test_halves_of_a_body_hang_together_by_the_skeleton():
    """Hips and spine meet in a seam; a shoulder and a haunch, along the flank."""
    hierarchy = np.zeros((4, 4), bool)
    hierarchy[0, 1] = hierarchy[0, 2] = hierarchy[2, 3] = True  # hips > haunch, spine > shoulder
    weights = np.vstack([np.eye(4), np.full((1, 4), 0.0)])
    weights[4, [1, 3]] = 0.5
    seam = np.array([[0.99, 0, 0.01, 0], [0.5, 0.5, 0, 0], [0, 0, 0.5, 0.5]])
    surface = np.array([1.0, 4, 1, 4, 3, 0.5, 0.5, 0.5]), np.vstack([weights, seam])
    order, tree = join_by_shared_surface(*surface, hierarchy)
    assert {
        tuple(sorted((int(order[j]), int(order[p])))) for j, p in enumerate(tree) if p >= 0
    } == {
        (0, 1),
        (0, 2),
        (2, 3),
    }

from dataclasses import fields

import numpy as np
import pytest

from bunraku import builtin
from bunraku.contacts import Leg, find_legs
from bunraku.formats import read_character
from bunraku.registration.body import wrap_character
from bunraku.skinning import forward_kinematics
from tests.contacts.walkers import JOINTS, NAMES, PARENTS, legs_of, surface


def assert_same(leg: Leg, other: Leg) -> None:
    for field in fields(Leg):
        np.testing.assert_array_equal(getattr(leg, field.name), getattr(other, field.name))


def test_the_legs_of_a_walker_by_hand():
    found = find_legs(*surface(), JOINTS, PARENTS)
    assert len(found) == 2
    for leg, expected in zip(found, legs_of(), strict=True):
        assert_same(leg, expected)


def test_size_and_heading_do_not_matter():
    points, weights = surface()
    turned = [3.0 * p[:, [2, 1, 0]] * [1.0, 1.0, -1.0] + [5.0, 7.0, 1.0] for p in (points, JOINTS)]
    found = find_legs(turned[0], weights, turned[1], PARENTS)
    for leg, expected in zip(found, legs_of(), strict=True):
        assert_same(leg, expected)


def test_a_robe_that_reaches_the_ground_from_the_knees_is_no_foot():
    points, weights = surface()
    robe = np.eye(9)[[NAMES.index("shankL"), NAMES.index("shankR")]]
    hems = [[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]]
    found = find_legs(np.vstack([points, hems]), np.vstack([weights, robe]), JOINTS, PARENTS)
    assert [leg.foot for leg in found] == [3, 7]


def test_a_tail_that_drags_along_the_ground_is_no_leg():
    tail = np.array([[0, 0.5, -0.1], [0, 0.3, -0.4], [0, 0.05, -0.8]])
    joints, parents = np.vstack([JOINTS, tail]), np.append(PARENTS, [0, 9, 10])
    points, weights = surface()
    points = np.vstack([points, tail, [[0.0, 0.0, -0.8]]])
    weights = np.block(
        [[weights, np.zeros((len(weights), 3))], [np.zeros((4, 9)), np.eye(3)[[0, 1, 2, 2]]]]
    )
    assert [leg.foot for leg in find_legs(points, weights, joints, parents)] == [3, 7]


def test_a_leg_is_cut_to_what_its_partner_has():
    """The rig hangs the left thigh on a shoulder of its own, the right one on the hips."""
    joints, parents = np.vstack([JOINTS, [[0.05, 0.55, 0.0]]]), np.append(PARENTS, 0)
    parents[1] = 9
    points, weights = surface()
    weights = np.column_stack([weights, np.zeros(len(weights))])
    assert [leg.hip for leg in find_legs(points, weights, joints, parents)] == [1, 5]


def test_a_foot_hung_elsewhere_goes_with_the_leg_it_lies_at():
    """As in rigs whose ankles follow a control at the root, the toes the leg."""
    parents = PARENTS.copy()
    parents[[3, 7]], parents[[4, 8]] = 0, [2, 6]
    left, right = find_legs(*surface(), JOINTS, parents)
    assert (left.foot, right.foot) == (4, 8)
    np.testing.assert_array_equal(np.sort(left.end), [3, 4])
    np.testing.assert_array_equal(np.sort(right.end), [7, 8])


def test_a_snake_has_no_legs():
    spine = np.column_stack([np.zeros(8), np.full(8, 0.05), np.arange(8.0)])
    body = np.vstack([spine, spine * [1, 0, 1], spine * [1, 2, 1]])
    assert not find_legs(body, np.tile(np.eye(8), (3, 1)), spine, np.arange(-1, 7))


def test_legs_of_one_bone_cannot_bend(creature):
    world = forward_kinematics(creature.skeleton.parents, creature.skeleton.rest)[:, :3, 3]
    mesh, skin = creature.mesh, creature.skin
    assert not find_legs(mesh.vertices, skin.weights, world, creature.skeleton.parents)


def test_the_built_in_human_stands_on_two_feet():
    human = builtin.human()
    names = human.skeleton.names
    joints = forward_kinematics(human.skeleton.parents, human.skeleton.rest)[:, :3, 3]
    legs = find_legs(human.mesh.vertices, human.skin.weights, joints, human.skeleton.parents)
    sides = [[names[j] for j in (leg.hip, leg.knee, leg.foot, *leg.soles)] for leg in legs]
    parts = ("UpperLeg", "LowerLeg", "Foot", "Foot", "Toes")
    assert sides == [[side + part for part in parts] for side in ("left", "right")]


@pytest.mark.parametrize(
    ("file", "feet"),
    [
        ("creatures/quaternius_animals/Horse.glb", 4),  # whose feet hang off the root
        ("creatures/mesh2motion/fox-animations.glb", 4),
        ("creatures/mesh2motion/spider-animations.glb", 8),
        ("creatures/mesh2motion/bird-animations.glb", 2),
        ("creatures/mesh2motion/snake-animations.glb", 0),
        ("stylised/kaykit_adventurers/Knight.glb", 2),
    ],
)
def test_creatures_of_other_makes(data, file, feet):
    body = wrap_character(read_character(data / file))
    found = find_legs(body.proxy.mesh.vertices, body.weights, body.joints, body.carriers)
    assert len(found) == feet

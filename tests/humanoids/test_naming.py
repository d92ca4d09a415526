import logging
from dataclasses import replace

import numpy as np
import pytest

from bunraku.humanoids import name_joints
from bunraku.types import MatchError, Skeleton

LIMBS = ("UpperLeg", "LowerLeg", "Foot", "Toes", "Shoulder", "UpperArm", "LowerArm", "Hand")
DIALECTS = {
    "mixamo": ("UpLeg", "Leg", "Foot", "ToeBase", "Shoulder", "Arm", "ForeArm", "Hand"),
    "cmu": ("Hip", "Knee", "Ankle", "Toe", "Collar", "Shoulder", "Elbow", "Wrist"),
    "unreal": ("thigh", "calf", "foot", "ball", "clavicle", "upperarm", "lowerarm", "hand"),
    "biped": ("Thigh", "Calf", "Foot", "Toe0", "Clavicle", "UpperArm", "Forearm", "Hand"),
}
PATTERNS = {
    "mixamo": "mixamorig:{Left}{bone}",
    "cmu": "{Left}{bone}",
    "unreal": "{bone}_{l}",
    "biped": "Bip01 {L} {bone}",
}


def expected(skeleton):
    return {
        name: joint
        for joint, name in enumerate(skeleton.names)
        if not name.endswith(("Tip", "Top"))
    }


def rename(skeleton, dialect):
    words = dict(zip(LIMBS, DIALECTS[dialect], strict=True))
    names = []
    for name in skeleton.names:
        side = next((s for s in ("left", "right") if name.startswith(s)), "")
        bone = words.get(name[len(side) :], f"{name}_end")
        if side:
            pattern = PATTERNS[dialect]
            names.append(pattern.format(Left=side.title(), l=side[0], L=side[0].upper(), bone=bone))
        else:
            names.append(name)
    return replace(skeleton, names=tuple(names))


def test_vrm_names_name_themselves(person):
    assert name_joints(person) == expected(person)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dialects_name_the_same_joints(person, dialect):
    assert name_joints(rename(person, dialect)) == expected(person)


def test_the_shape_alone_is_enough(person):
    nameless = replace(person, names=tuple(f"Bone.{i:03}" for i in range(len(person.names))))
    assert name_joints(nameless) == expected(person)


def test_size_and_order_of_joints_do_not_matter(person, rng):
    rest = person.rest.copy()
    rest[:, :3, 3] *= 0.01
    order = sorted(range(len(person.names)), key=lambda j: (depth(person, j), rng.random()))
    place = np.argsort(order)
    parents = [place[person.parents[j]] if person.parents[j] >= 0 else -1 for j in order]
    names = [person.names[j] for j in order]
    for called in (names, [f"j{i}" for i in range(len(names))]):
        shuffled = Skeleton(tuple(called), np.array(parents), rest[order])
        found = name_joints(shuffled)
        assert {bone: names[joint] for bone, joint in found.items()} == {b: b for b in found}
        assert len(found) == len(expected(person))


def depth(skeleton, joint):
    count = 0
    while skeleton.parents[joint] >= 0:
        joint, count = skeleton.parents[joint], count + 1
    return count


def test_names_of_the_wrong_side_are_mended(person, caplog):
    swapped = tuple(
        name.replace("left", "?").replace("right", "left").replace("?", "right")
        for name in person.names
    )
    with caplog.at_level(logging.WARNING):
        assert name_joints(replace(person, names=swapped)) == expected(person)
    assert "joints called left lie on the right" in caplog.text


def test_a_helper_above_a_joint_of_the_same_name_is_passed_over(person):
    names = list(person.names)
    at = names.index("leftUpperLeg")
    rest = np.insert(person.rest, at, np.eye(4), axis=0)
    parents = np.array([p + (p >= at) for p in person.parents])
    parents = np.insert(parents, at, 0)
    parents[at + 1] = at
    names.insert(at, "__leftUpperLeg")
    found = name_joints(Skeleton(tuple(names), parents, rest))
    assert found["leftUpperLeg"] == at + 1


def test_fingers_are_named_in_order(person):
    hand = person.names.index("leftHand")
    added = ("LeftHandIndex1", "LeftHandIndex2", "LeftHandIndex3", "tip_end")
    count = len(person.names)
    rest = np.concatenate([person.rest, np.tile(np.eye(4), (4, 1, 1))])
    rest[count:, 0, 3] = 0.03
    parents = np.concatenate([person.parents, [hand, count, count + 1, count + 2]])
    found = name_joints(Skeleton(person.names + added, parents, rest))
    assert [found[f"leftIndex{p}"] - count for p in ("Proximal", "Intermediate", "Distal")] == [
        0,
        1,
        2,
    ]


def test_a_snake_is_refused():
    rest = np.tile(np.eye(4), (9, 1, 1))
    rest[1:, 2, 3] = 0.1
    snake = Skeleton(tuple(f"tail{i}" for i in range(9)), np.arange(-1, 8), rest)
    with pytest.raises(MatchError, match="a skeleton of 9 joints shows no two legs and two arms"):
        name_joints(snake)


def test_two_trees_are_refused(person):
    parents = person.parents.copy()
    parents[person.names.index("upperChest")] = -1
    with pytest.raises(MatchError, match="legs and arms hang on different roots"):
        name_joints(replace(person, parents=parents))

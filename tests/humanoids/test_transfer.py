from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.humanoids import name_joints, transfer_motion
from bunraku.humanoids.transfer import share_along
from bunraku.skinning import clip_transforms, forward_kinematics
from bunraku.types import Clip, Skeleton

BONES = [
    (side + upper, side + lower)
    for side in ("left", "right")
    for upper, lower in (
        ("UpperLeg", "LowerLeg"),
        ("LowerLeg", "Foot"),
        ("UpperArm", "LowerArm"),
        ("LowerArm", "Hand"),
    )
]


def world(skeleton, clip):
    return forward_kinematics(skeleton.parents, clip_transforms(clip))


def directions(skeleton, clip):
    named, moved = name_joints(skeleton), world(skeleton, clip)[..., :3, 3]
    ways = np.stack([moved[:, named[b]] - moved[:, named[a]] for a, b in BONES], axis=1)
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


def repose(skeleton, clip, turns):
    """Give the same motion in a skeleton whose rest pose has joints turned, bones unturned."""
    local = skeleton.rest.copy()
    for name, vector in turns.items():
        local[skeleton.names.index(name), :3, :3] = Rotation.from_rotvec(vector).as_matrix()
    posed = forward_kinematics(skeleton.parents, local)
    rest = np.tile(np.eye(4), (len(posed), 1, 1))
    rest[:, :3, 3] = posed[:, :3, 3]
    child = skeleton.parents >= 0
    rest[child, :3, 3] -= posed[skeleton.parents[child], :3, 3]
    moved = world(skeleton, clip)
    moved[..., :3, :3] = moved[..., :3, :3] @ np.swapaxes(posed[:, :3, :3], -1, -2)
    new = replace(skeleton, rest=rest)
    above = moved[:, skeleton.parents]
    turns_local = np.where(
        child[:, None, None],
        np.swapaxes(above[..., :3, :3], -1, -2) @ moved[..., :3, :3],
        moved[..., :3, :3],
    )
    translations = np.tile(rest[:, :3, 3], (len(moved), 1, 1))
    translations[:, ~child] = clip.translations[:, ~child]
    rotations = Rotation.from_matrix(turns_local.reshape(-1, 3, 3)).as_quat()
    shape = clip.rotations.shape
    return new, Clip(clip.name, clip.times, translations, rotations.reshape(shape), clip.scales)


ARMS_DOWN = {"leftUpperArm": [0, 0, -1.5], "rightUpperArm": [0, 0, 1.5]}
ARMS_UP = {"leftUpperArm": [0, 0, 1.4], "rightUpperArm": [0, 0, -1.4]}
BENT = {
    "leftUpperArm": [0, 0, -0.8],
    "rightUpperArm": [0, 0, 0.8],
    "leftLowerArm": [0, -0.6, 0],
    "rightLowerArm": [0, 0.6, 0],
    "leftUpperLeg": [-0.2, 0, 0.2],
    "rightUpperLeg": [-0.2, 0, -0.2],
    "leftLowerLeg": [0.4, 0, 0],
    "rightLowerLeg": [0.4, 0, 0],
}
ONE_LINE = {  # legs sideways and the trunk folded, as recordings with bones along one axis have it
    "leftUpperLeg": [0, 0, 1.57],
    "rightUpperLeg": [0, 0, 1.57],
    "chest": [0, 0, -1.57],
}


def test_a_motion_onto_its_own_skeleton_stays(person, dance):
    found = transfer_motion(person, dance, person)
    assert found.name == "dance"
    np.testing.assert_array_equal(found.times, dance.times)
    turns = Rotation.from_quat(found.rotations.reshape(-1, 4)).inv() * Rotation.from_quat(
        dance.rotations.reshape(-1, 4)
    )
    driven = np.array([not name.endswith(("Tip", "Top")) for name in person.names])
    angles = turns.magnitude().reshape(len(dance.times), -1)[:, driven]
    # knees and elbows show their hinges a little off the natural axis, in a random dance
    assert angles.max() < 0.12
    way = found.translations[:, 0] - found.translations[0, 0]
    np.testing.assert_allclose(way, dance.translations[:, 0] - dance.translations[0, 0], atol=1e-9)


@pytest.mark.parametrize("turns", [ARMS_DOWN, ARMS_UP, BENT, ONE_LINE])
def test_bones_point_the_same_way_from_any_rest_pose(person, dance, turns):
    source, clip = repose(person, dance, turns)
    np.testing.assert_allclose(directions(source, clip), directions(person, dance), atol=1e-9)
    found = transfer_motion(source, clip, person)
    np.testing.assert_allclose(directions(person, found), directions(source, clip), atol=1e-9)


@pytest.mark.parametrize("turns", [ARMS_DOWN, ARMS_UP, BENT, ONE_LINE])
def test_knees_and_elbows_bend_about_their_own_hinges(person, dance, turns):
    source, clip = repose(person, dance, turns)
    found = transfer_motion(source, clip, person)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for bone, axis in (("LowerLeg", [1.0, 0, 0]), ("LowerArm", [0, -sign, 0])):
            joint = person.names.index(side + bone)
            bend = Rotation.from_quat(found.rotations[:, joint]).as_rotvec()
            along = bend @ np.array(axis)
            assert (along > 0.5).all(), (side, bone)
            assert np.linalg.norm(bend - along[:, None] * axis, axis=1).max() < 0.25


def test_a_trunk_that_is_folded_at_rest_is_not_folded_in_the_clip(person, dance):
    dance.rotations[4] = [0, 0, 0, 1]  # it stands once, which is what the fold is measured from
    source, clip = repose(person, dance, ONE_LINE)
    found = world(person, transfer_motion(source, clip, person))
    wanted = world(person, dance)
    for bone in ("hips", "upperChest", "head"):
        joint = person.names.index(bone)
        np.testing.assert_allclose(found[:, joint, :3, :3], wanted[:, joint, :3, :3], atol=1e-9)


def test_a_twisted_rest_pose_does_not_turn_knees_around(person, dance):
    source, clip = repose(person, dance, {"leftUpperLeg": [0, 3.0, 0]})
    found = transfer_motion(source, clip, person)
    knee = Rotation.from_quat(found.rotations[:, person.names.index("leftLowerLeg")]).as_rotvec()
    assert (knee[:, 0] > 0.5).all()


def test_size_scales_the_way_and_feet_stand_on_the_target_floor(person, dance):
    small = person.rest.copy()
    small[:, :3, 3] *= 0.4
    onto = replace(person, rest=small)
    plain = transfer_motion(person, dance, onto)
    way = np.ptp(plain.translations[:, 0], axis=0)
    np.testing.assert_allclose(way, 0.4 * np.ptp(dance.translations[:, 0], axis=0), atol=1e-9)
    np.testing.assert_allclose(plain.translations[0, 0, [0, 2]], 0, atol=1e-12)
    feet = [person.names.index(f"{s}{b}") for s in ("left", "right") for b in ("Foot", "Toes")]
    heights = world(onto, plain)[:, feet, 1, 3]
    rest = forward_kinematics(onto.parents, onto.rest)[feet, 1, 3]
    assert np.percentile((heights - rest).min(axis=1), 5) == pytest.approx(0, abs=1e-9)
    raised = replace(dance, translations=dance.translations.copy())
    raised.translations[:, 0, 1] += 0.7
    again = transfer_motion(person, raised, onto)
    np.testing.assert_allclose(again.translations, plain.translations, atol=1e-9)


def test_a_quarter_turn_of_the_source_is_taken_back(person, dance):
    turn = Rotation.from_rotvec([0, np.pi / 2, 0])
    rest = person.rest.copy()
    rest[0, :3, :3] = turn.as_matrix()
    clip = replace(dance, rotations=dance.rotations.copy(), translations=dance.translations.copy())
    clip.rotations[:, 0] = (turn * Rotation.from_quat(dance.rotations[:, 0])).as_quat()
    clip.translations[:, 0] = turn.apply(dance.translations[:, 0])
    found = transfer_motion(replace(person, rest=rest), clip, person)
    straight = transfer_motion(person, dance, person)
    np.testing.assert_allclose(directions(person, found), directions(person, straight), atol=1e-6)
    np.testing.assert_allclose(found.translations, straight.translations, atol=1e-9)


def test_a_heading_in_the_clip_is_kept(person, dance):
    turn = Rotation.from_rotvec([0, 2.0, 0])
    clip = replace(dance, rotations=dance.rotations.copy(), translations=dance.translations.copy())
    clip.rotations[:, 0] = (turn * Rotation.from_quat(dance.rotations[:, 0])).as_quat()
    clip.translations[:, 0] = turn.apply(dance.translations[:, 0])
    found = transfer_motion(person, clip, person)
    np.testing.assert_allclose(directions(person, found), directions(person, clip), atol=1e-9)


def test_one_frame_gives_one_frame(person, dance):
    still = Clip(
        "pose", dance.times[:1], dance.translations[:1], dance.rotations[:1], dance.scales[:1]
    )
    assert transfer_motion(person, still, person).rotations.shape == (1, len(person.names), 4)


def test_joints_without_a_counterpart_stay_at_rest(person, dance):
    count = len(person.names)
    extra = Skeleton(
        (*person.names, "tail"),
        np.append(person.parents, 0),
        np.concatenate([person.rest, [np.eye(4)]]),
    )
    found = transfer_motion(person, dance, extra)
    np.testing.assert_allclose(
        found.rotations[:, count], np.tile([0, 0, 0, 1.0], (12, 1)), atol=1e-9
    )


def test_fewer_spine_joints_reach_the_same_chest(person, dance):
    joint = person.names.index("chest")
    keep = [i for i in range(len(person.names)) if i != joint]
    rest = person.rest[keep].copy()
    rest[keep.index(joint + 1), :3, 3] += person.rest[joint, :3, 3]
    parents = np.where(person.parents == joint, joint - 1, person.parents)[keep]
    parents = np.array([keep.index(p) if p >= 0 else -1 for p in parents])
    short = Skeleton(tuple(person.names[i] for i in keep), parents, rest)
    for source, target, clip in (
        (person, short, dance),
        (short, person, transfer_motion(person, dance, short)),
    ):
        found = transfer_motion(source, clip, target)
        top = world(target, found)[:, target.names.index("upperChest"), :3, :3]
        wanted = world(source, clip)[:, source.names.index("upperChest"), :3, :3]
        np.testing.assert_allclose(top, wanted, atol=1e-9)


def test_shares_along_a_chain_by_hand():
    bend = Rotation.from_rotvec([[0, 0, 0], [0, 0, 0.6]]).as_matrix()[None]
    shared = share_along(bend, 4)
    angles = Rotation.from_matrix(shared[0]).as_rotvec()[:, 2]
    np.testing.assert_allclose(angles, [0, 0.2, 0.4, 0.6])
    np.testing.assert_allclose(share_along(share_along(bend, 4), 2), bend, atol=1e-12)
    np.testing.assert_allclose(share_along(bend[:, :1], 3), np.tile(np.eye(3), (1, 3, 1, 1)))


def test_recordings_of_every_make_move_the_built_in_human(data):
    from bunraku.builtin import human
    from bunraku.formats import read_motion

    target = human().skeleton
    for path in sorted((data / "mocap").glob("*/*.bvh")):
        skeleton, clip = read_motion(path)
        found = transfer_motion(skeleton, clip, target)
        cosines = (directions(target, found) * directions(skeleton, clip)).sum(axis=-1)
        assert np.degrees(np.arccos(np.clip(cosines, -1, 1))).mean() < 3.0, path

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku import builtin
from bunraku.contacts import Arm, Dressed, find_legs, swing_arm
from bunraku.contacts.clearance import inside_share
from bunraku.evaluate.metrics import foot_contacts, foot_slide
from bunraku.registration.body import Body
from bunraku.registration.moments import no_moments
from bunraku.reposing import Reposed
from bunraku.retargeting import (
    Retarget,
    as_clip,
    carry_clips,
    carry_frames,
    face_heading,
    heading_frames,
    length_ratio,
    place_in_frame,
    plan_embedded,
    plan_retarget,
    retarget_clip,
    skeleton_of,
    stand_floor_joints,
    start_above,
    turned_frames,
)
from bunraku.rotations import compose_transforms, rotation_angles, vectors_to_matrices
from bunraku.skinning import clip_transforms, forward_kinematics
from bunraku.types import Character, Clip, Mesh, Skeleton
from tests.creatures import JOINTS, NAMES, PARENTS

AHEAD = np.eye(3)
LEFT = Rotation.from_euler("y", 90, degrees=True).as_matrix()


def world_of(skeleton: Skeleton, clip: Clip) -> np.ndarray:
    return forward_kinematics(skeleton.parents, clip_transforms(clip))


def plan(creature, **changes) -> Retarget:
    """Retarget the creature to itself, but for what is changed."""
    same = Retarget(creature.skeleton, JOINTS, PARENTS, 1.0, AHEAD)
    return replace(same, **changes)


@pytest.fixture
def rig() -> tuple[Skeleton, Clip]:
    """Hips, a leg below them, and its foot, which hangs off the hips as in rigs with IK."""
    rest = np.tile(np.eye(4), (3, 1, 1))
    rest[:, :3, 3] = [[0, 1, 0], [0, 0, 0], [0, -1, 0]]
    skeleton = Skeleton(("hips", "leg", "foot"), np.array([-1, 0, 0]), rest)
    swing = vectors_to_matrices(np.outer([0.0, 0.3, 0.6], [1.0, 0, 0]))
    local = np.tile(rest, (3, 1, 1, 1))
    local[:, 1, :3, :3] = swing  # the foot follows the end of the leg
    local[:, 2, :3, 3] = np.einsum("fab,b->fa", swing, [0.0, -1, 0])
    return skeleton, as_clip(Clip("Kick", np.arange(3.0), *standing(3, 3)), local)


def standing(frames: int, joints: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    still = np.tile([0.0, 0, 0, 1], (frames, joints, 1))
    return np.zeros((frames, joints, 3)), still, np.ones((frames, joints, 3))


def test_a_leg_twice_as_long_by_hand(rig):
    """World turns are copied; the foot, carried by its leg, stays at the end of it."""
    skeleton, clip = rig
    longer = np.array([[0.0, 2, 0], [0, 2, 0], [0, 0, 0]])
    carried = retarget_clip(clip, Retarget(skeleton, longer, np.array([-1, 0, 1]), 2.0, AHEAD))
    world = world_of(skeleton, carried)
    for frame, angle in enumerate([0.0, 0.3, 0.6]):
        foot = [0, 2 - 2 * np.cos(angle), -2 * np.sin(angle)]
        np.testing.assert_allclose(world[frame, 2, :3, 3], foot, atol=1e-9)
    np.testing.assert_allclose(world[:, :, :3, :3], world_of(skeleton, clip)[:, :, :3, :3])


def test_a_foot_carried_by_its_leg_keeps_its_distance_on_any_leg(rig):
    skeleton, clip = rig
    crooked = np.array([[0.0, 1, 0], [0.1, 0.9, 0], [0.1, 0.2, 0.3]])
    carried = retarget_clip(clip, Retarget(skeleton, crooked, np.array([-1, 0, 1]), 1.0, AHEAD))
    world = world_of(skeleton, carried)[:, :, :3, 3]
    length = np.linalg.norm(world[:, 2] - world[:, 1], axis=1)
    np.testing.assert_allclose(length, np.linalg.norm(crooked[2] - crooked[1]))


def test_retargeting_to_the_same_skeleton_changes_nothing(creature):
    clip = creature.clips[0]
    carried = retarget_clip(clip, plan(creature))
    assert carried.name == clip.name
    np.testing.assert_array_equal(carried.times, clip.times)
    expected = world_of(creature.skeleton, clip)
    np.testing.assert_allclose(world_of(creature.skeleton, carried), expected, atol=1e-9)


def test_a_figure_twice_the_size_travels_twice_as_far(creature):
    clip = creature.clips[0]
    twice = plan(creature, places=2 * JOINTS, scale=2.0)
    figure = skeleton_of(creature.skeleton, turned_frames(creature.skeleton, 2 * JOINTS))
    before = world_of(creature.skeleton, clip)
    after = world_of(figure, retarget_clip(clip, twice))
    np.testing.assert_allclose(after[..., :3, 3], 2 * before[..., :3, 3], atol=1e-9)
    np.testing.assert_allclose(after[..., :3, :3], before[..., :3, :3], atol=1e-9)


def test_travel_is_scaled_apart_from_the_figure(creature):
    clip = creature.clips[0]
    before = world_of(creature.skeleton, clip)[:, 0, :3, 3]
    short = plan(creature, scale=0.5)
    after = world_of(creature.skeleton, retarget_clip(clip, short))[:, 0, :3, 3]
    np.testing.assert_allclose(after - after[0], 0.5 * (before - before[0]), atol=1e-9)


def test_other_proportions_keep_their_bones_and_take_the_world_turns(creature, rng):
    clip, places = creature.clips[0], JOINTS + rng.normal(scale=0.05, size=JOINTS.shape)
    after = world_of(creature.skeleton, retarget_clip(clip, plan(creature, places=places)))
    before = world_of(creature.skeleton, clip)
    np.testing.assert_allclose(after[..., :3, :3], before[..., :3, :3], atol=1e-9)
    joints = after[..., :3, 3]
    lengths = np.linalg.norm(joints[:, 1:] - joints[:, PARENTS[1:]], axis=2)
    own = np.linalg.norm(places[1:] - places[PARENTS[1:]], axis=1)
    np.testing.assert_allclose(lengths, np.tile(own, (len(lengths), 1)), atol=1e-9)


def test_a_figure_that_faces_left_moves_to_the_left(creature):
    clip = creature.clips[0]
    before = world_of(creature.skeleton, clip)
    after = world_of(creature.skeleton, retarget_clip(clip, plan(creature, heading=LEFT)))
    turned = face_heading(plan(creature, heading=LEFT)) @ before
    np.testing.assert_allclose(after, turned, atol=1e-9)
    way = after[-1, 0, :3, 3] - after[0, 0, :3, 3]
    np.testing.assert_allclose(way, [0.5, 0.05, 0.0], atol=1e-9)  # the source walks along +Z


def test_a_bone_that_a_clip_stretches_is_stretched_alike(creature):
    clip, head = creature.clips[0], NAMES.index("head")
    translations = clip.translations.copy()
    translations[4, head] *= 1.5
    stretched = replace(clip, translations=translations)
    places = JOINTS.copy()
    places[head] = JOINTS[1] + 2 * (JOINTS[head] - JOINTS[1])
    after = world_of(creature.skeleton, retarget_clip(stretched, plan(creature, places=places)))
    length = np.linalg.norm(after[:, head, :3, 3] - after[:, 1, :3, 3], axis=1)
    own = np.linalg.norm(places[head] - places[1])
    np.testing.assert_allclose(length / own, np.where(np.arange(8) == 4, 1.5, 1.0), atol=1e-9)


def test_scales_of_a_clip_are_kept(creature):
    clip = creature.clips[0]
    scales = clip.scales.copy()
    scales[:, NAMES.index("leftArm")] = [1.0, 1.3, 1.0]
    squashed = replace(clip, scales=scales)
    carried = retarget_clip(squashed, plan(creature, places=1.2 * JOINTS))
    np.testing.assert_allclose(carried.scales, scales, atol=1e-9)


def test_what_a_clip_scales_to_nothing_nearly_vanishes(creature):
    (clip,) = creature.clips
    chest = NAMES.index("chest")
    scales = clip.scales.copy()
    scales[3:, chest] = 0.0
    carried = retarget_clip(replace(clip, scales=scales), plan(creature))
    world = world_of(creature.skeleton, carried)
    size = np.linalg.norm(world[:, :, :3, :3], axis=2).max(axis=2)
    np.testing.assert_allclose(size[:3], 1)
    for joint, name in enumerate(NAMES):
        gone = name in ("chest", "head", "leftArm", "rightArm")
        np.testing.assert_allclose(size[3:, joint], 1e-3 if gone else 1)
    places = world[3:, :, :3, 3]
    assert np.linalg.norm(places[:, NAMES.index("head")] - places[:, chest], axis=1).max() < 1e-3


def test_the_order_of_joints_does_not_matter(creature):
    """Carriers may come after what they carry, as feet stored before their legs."""
    swap = np.array([0, 1, 2, 3, 4, 6, 5])
    frames = forward_kinematics(PARENTS, creature.skeleton.rest)[swap]
    skeleton = skeleton_of(creature.skeleton, frames)
    clip = creature.clips[0]
    parts = (getattr(clip, name)[:, swap] for name in ("translations", "rotations", "scales"))
    shuffled = Clip(clip.name, clip.times, *parts)
    carriers = np.array([-1, 0, 1, 1, 1, 6, 0])  # the right leg by the left, stored after it
    plain = np.array([-1, 0, 1, 1, 1, 0, 5])
    places = JOINTS * [1.1, 1.0, 0.9]
    one = retarget_clip(clip, plan(creature, places=places, carriers=plain))
    other = retarget_clip(shuffled, Retarget(skeleton, places[swap], carriers, 1.0, AHEAD))
    np.testing.assert_allclose(
        world_of(skeleton, other), world_of(creature.skeleton, one)[:, swap], atol=1e-9
    )


def test_a_bones_place_in_its_carriers_frame_by_hand():
    carrier = compose_transforms(np.array([1.0, 0, 0]), LEFT)  # its Z looks along the world's X
    joint = compose_transforms(np.array([3.0, 0, 0]), AHEAD)
    np.testing.assert_allclose(place_in_frame(carrier, joint), [0, 0, 2], atol=1e-12)


@pytest.mark.parametrize(
    ("own", "offset", "ratio"), [(2.0, 1.0, 2.0), (50.0, 1.0, 12.0), (0.0, 1.0, 0.75), (9.0, 0, 3)]
)
def test_length_ratios_stay_within_four_times_the_figures(own, offset, ratio):
    found = length_ratio(np.array([own, 0, 0]), np.array([0, float(offset), 0]), 3.0)
    assert np.isclose(found, ratio)


def test_a_clip_survives_the_way_through_matrices(creature):
    clip = creature.clips[0]
    back = as_clip(clip, clip_transforms(clip))
    np.testing.assert_allclose(back.translations, clip.translations, atol=1e-12)
    np.testing.assert_allclose(back.scales, clip.scales, atol=1e-9)
    np.testing.assert_allclose(clip_transforms(back), clip_transforms(clip), atol=1e-9)


def test_neighbouring_quaternions_lie_on_one_side():
    """A whole turn about Z, through the half turn where w changes sign."""
    angles = np.linspace(0, 2 * np.pi, 24)
    turns = vectors_to_matrices(angles[:, None, None] * np.array([0.0, 0, 1]))
    local = compose_transforms(np.zeros((24, 1, 3)), turns)
    clip = as_clip(Clip("Spin", np.arange(24.0), *standing(24, 1)), local)
    dots = np.einsum("fjc,fjc->fj", clip.rotations[1:], clip.rotations[:-1])
    assert (dots > 0.98).all()
    np.testing.assert_allclose(clip_transforms(clip), local, atol=1e-12)


def test_turned_frames_are_the_sources_own_at_its_own_joints(creature):
    world = forward_kinematics(PARENTS, creature.skeleton.rest)
    np.testing.assert_allclose(turned_frames(creature.skeleton, JOINTS), world, atol=1e-9)
    turns = np.tile(LEFT, (7, 1, 1))
    turned = turned_frames(creature.skeleton, JOINTS, turns)
    np.testing.assert_allclose(turned[:, :3, :3], LEFT @ world[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(turned[:, :3, 3], JOINTS)
    skeleton = skeleton_of(creature.skeleton, world)
    np.testing.assert_allclose(skeleton.rest, creature.skeleton.rest, atol=1e-9)


def test_a_heading_turns_the_rest_pose_about_the_root(creature):
    world = heading_frames(plan(creature, heading=LEFT))
    np.testing.assert_allclose(world[0, :3, 3], JOINTS[0], atol=1e-12)
    left_arm = world[3, :3, 3] - world[0, :3, 3]
    np.testing.assert_allclose(left_arm, LEFT @ (JOINTS[3] - JOINTS[0]), atol=1e-12)


def plan_for(body: Body, creature: Character, vertices: np.ndarray, **reposed) -> Retarget:
    """Plan for a copy of the creature, found at rest but for what is said."""
    still = np.tile(np.eye(3), (7, 1, 1))
    rest = Reposed(JOINTS, still, AHEAD, JOINTS, 0.0)
    figure = Mesh(np.vstack([vertices, [[0, -50.0, 0]]]), creature.mesh.faces)  # one is stray
    weights = np.vstack([creature.skin.weights, np.eye(7)[:1]])
    return plan_retarget(body, replace(rest, **reposed), figure, weights, creature.skeleton)[0]


def test_a_figure_like_the_source_is_planned_as_the_source(body, creature):
    found = plan_for(body, creature, creature.mesh.vertices)
    np.testing.assert_allclose(found.places, JOINTS, atol=1e-9)
    assert abs(found.scale - 1.0) < 0.02


def test_a_rigs_origin_lies_on_the_floor_of_a_figure_with_longer_legs(body, creature):
    """Whichever way the figure faces and however its hips have turned."""
    floor, hips = np.array([0.1, 0.02, 0.05]), JOINTS[0]
    parents = np.append(-1, PARENTS + 1)
    joints = np.vstack([floor, JOINTS])
    puppet = replace(body.puppet, joints=body.puppet.joints + 1)
    rooted = replace(
        body,
        joints=joints,
        parents=parents,
        carriers=parents,
        puppet=puppet,
        weights=np.insert(body.weights, 0, 0.0, axis=1),
        moments=no_moments(len(body.joints) + 1),
    )
    places = joints + np.array([0.0, 0.3, 0.0])
    found = 2.0 * places
    turns = np.tile(LEFT, (8, 1, 1))
    reposed = Reposed(found, turns, LEFT, places, 1.0)
    plan = Retarget(creature.skeleton, places, parents, 1.5, LEFT)
    stood, moved = stand_floor_joints(rooted, reposed, plan)
    np.testing.assert_allclose(stood.places[0] - stood.places[1], 1.5 * (floor - hips), atol=1e-12)
    np.testing.assert_allclose(
        moved.found[0] - found[1], LEFT @ LEFT @ (1.5 * (floor - hips)), atol=1e-12
    )
    np.testing.assert_array_equal(moved.found[1:], found[1:])
    seen = [(face_heading(one) @ to_homogeneous(one.places[1:]).T).T for one in (plan, stood)]
    np.testing.assert_allclose(seen[1], seen[0], atol=1e-12)  # the body itself stays in its place


def to_homogeneous(points: np.ndarray) -> np.ndarray:
    return np.column_stack([points, np.ones(len(points))])


def test_a_body_that_hangs_from_its_hips_has_no_floor_joints(body, creature):
    reposed = Reposed(JOINTS, np.tile(AHEAD, (7, 1, 1)), AHEAD, JOINTS, 0.0)
    unmoved = plan(creature)
    assert stand_floor_joints(body, reposed, unmoved) == (unmoved, reposed)


def test_travel_is_scaled_by_the_height_of_the_hips(body, creature):
    found = plan_for(
        body, creature, 3 * creature.mesh.vertices, found=3 * JOINTS, places=3 * JOINTS
    )
    assert np.isclose(found.scale / plan_for(body, creature, creature.mesh.vertices).scale, 3.0)


def test_planted_feet_of_the_human_stay_on_longer_legs(caplog):
    """The built-in human's walk, on shanks a fifth longer under thighs a fifth shorter."""
    human = builtin.human()
    parents = human.skeleton.parents
    joints = forward_kinematics(parents, human.skeleton.rest)[:, :3, 3]
    legs = find_legs(human.mesh.vertices, human.skin.weights, joints, parents)
    places = joints.copy()
    for leg in legs:
        places[leg.knee] += 0.2 * (joints[leg.hip] - joints[leg.knee])
    walk = next(clip for clip in human.clips if clip.name == "walk")
    free = Retarget(human.skeleton, places, parents, 1.0, AHEAD)
    own, slid, stayed = (
        world_of(human.skeleton, clip)[..., :3, 3]
        for clip in (
            walk,
            retarget_clip(walk, free),
            retarget_clip(walk, replace(free, legs=legs, height=1.7)),
        )
    )
    soles = legs[0].soles
    planted = foot_contacts(own[:, soles], walk.times, 1.7)
    slides = [foot_slide(path[:, soles], planted, walk.times) for path in (own, slid, stayed)]
    assert slides[1] > 1.2 * slides[0] and slides[2] < 1.1 * slides[0]
    lengths = np.linalg.norm(stayed[:, 1:] - stayed[:, parents[1:]], axis=2)
    expected = np.linalg.norm(places[1:] - places[parents[1:]], axis=1)
    np.testing.assert_allclose(lengths, np.tile(expected, (len(lengths), 1)), atol=1e-9)


def test_a_figure_caught_in_a_crouch_is_stood_on_the_floor(body, creature):
    """Hips found low and ahead of the origin, facing left."""
    aside = JOINTS @ LEFT.T + [0.1, -0.2, 0.2]
    ahead = (aside - aside[0]) @ LEFT + aside[0]
    vertices = creature.mesh.vertices @ LEFT.T + [0.1, -0.2, 0.2]
    caught = {"found": aside, "places": ahead, "heading": LEFT, "posed": 1.0}
    rest = heading_frames(plan_for(body, creature, vertices, **caught, trunk=1.0))
    lift = rest[0, :3, 3] - aside[0]
    assert abs((vertices + lift)[:, 1].min()) < 1e-9
    np.testing.assert_allclose(rest[0, [0, 2], 3], 0, atol=1e-9)
    unlike = heading_frames(plan_for(body, creature, vertices, **caught, trunk=0.0))
    np.testing.assert_allclose(unlike[0, [0, 2], 3], 0, atol=1e-9)  # hips and surface agree
    assert unlike[0, 1, 3] == pytest.approx(rest[0, 1, 3])


def test_a_swing_moves_an_arm_in_every_clip(creature):
    arm = Arm(3, 1, np.array([3]), np.array([3]), 1.0)
    still = plan(creature)
    before, after = (
        world_of(creature.skeleton, retarget_clip(creature.clips[0], one))
        for one in (still, replace(still, swings=((arm, 0.2),)))
    )
    others = np.arange(7) != 3
    np.testing.assert_allclose(after[:, others], before[:, others], atol=1e-9)
    turned = np.swapaxes(before[:, 3, :3, :3], 1, 2) @ after[:, 3, :3, :3]
    np.testing.assert_allclose(rotation_angles(turned), 0.2, atol=1e-9)


def test_a_stout_figure_holds_its_arms_away():
    """The built-in human, but with a belly that its own arms would go into."""
    human = builtin.human()
    joints = forward_kinematics(human.skeleton.parents, human.skeleton.rest)[:, :3, 3]
    names = human.skeleton.names
    arms = [index for index, name in enumerate(names) if "Arm" in name or "Hand" in name]
    vertices = human.mesh.vertices.copy()
    away = (vertices[:, 1] - joints[names.index("hips"), 1] - 0.1) / 0.18
    armless = 1 - np.clip(2 * human.skin.weights[:, arms].sum(axis=1), 0, 1)
    vertices[:, [0, 2]] *= 1 + 0.6 * (np.exp(-(away**2)) * armless)[:, None]
    rest = forward_kinematics(human.skeleton.parents, human.skeleton.rest)
    slim = Dressed(human.mesh, human.skin.weights, rest)
    stout = replace(slim, mesh=Mesh(vertices, human.mesh.faces))
    same = Retarget(human.skeleton, joints, human.skeleton.parents, 1.0, AHEAD)
    free, _ = carry_clips(human.clips, same, slim, slim)
    held, carried = carry_clips(human.clips, same, slim, stout)
    assert free.swings == () and len(held.swings) == 2 and len(carried) == len(human.clips)
    idle = next(clip for clip in human.clips if clip.name == "idle")
    frames, rest = carry_frames(idle, same)[::30], turned_frames(human.skeleton, joints)
    for arm, angle in held.swings:
        assert 0 < np.rad2deg(angle) <= 20
        before = inside_share(frames, arm, stout)
        after = inside_share(swing_arm(frames, rest, arm, angle), arm, stout)
        assert after < 0.5 * before


def test_an_embedded_skeleton_turned_in_the_figure_is_turned_back(creature):
    """A figure that stands as the source does at one moment, turned left, twice the size, aside."""
    clip, skeleton = creature.clips[0], creature.skeleton
    rest = forward_kinematics(PARENTS, skeleton.rest)
    moment = world_of(skeleton, clip)[5]
    turns = moment[:, :3, :3] @ np.swapaxes(rest[:, :3, :3], 1, 2)
    joints = 2 * moment[:, :3, 3] @ LEFT.T + [3.0, 0, 0]
    planned = plan_embedded(skeleton, joints, turns, LEFT, 2.0)
    carried = retarget_clip(clip, planned)
    frames = forward_kinematics(PARENTS, clip_transforms(carried))
    truth = world_of(skeleton, clip)
    expected = 2 * truth[..., :3, 3] @ LEFT.T
    shift = frames[0, 0, :3, 3] - expected[0, 0]
    np.testing.assert_allclose(frames[..., :3, 3], expected + shift, atol=1e-9)
    np.testing.assert_allclose(frames[..., :3, :3], LEFT @ truth[..., :3, :3], atol=1e-9)


def test_a_clip_starts_above_a_place_and_keeps_its_height(creature):
    clip = creature.clips[0]
    moved = start_above(clip, np.array([7.0, 100.0, -2.0]))
    np.testing.assert_allclose(moved.translations[0, 0, [0, 2]], [7.0, -2.0])
    np.testing.assert_array_equal(moved.translations[:, 0, 1], clip.translations[:, 0, 1])
    np.testing.assert_allclose(
        np.diff(moved.translations, axis=0), np.diff(clip.translations, axis=0), atol=1e-12
    )

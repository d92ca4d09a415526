import dataclasses

import numpy as np
import pytest

from bunraku.neural.anatomy import PERSON
from bunraku.neural.avatars import (
    mend_weights,
    rest_difference,
    rig_avatar,
    rigid_parts,
    settle_joints,
)
from bunraku.neural.bodies import Body, pose_body, pose_motion
from bunraku.neural.corpus import draw_sculpted
from bunraku.neural.parts import Understanding
from bunraku.neural.variation import arm_turns, chain_turns, vary_body
from bunraku.rotations import vectors_to_matrices
from bunraku.skinning import play_clip


def known(body: Body) -> Understanding:
    return Understanding(body.kind, 1.0, body.weights, body.joints, 1.0)


def random_turns(body: Body, rng: np.random.Generator, frames: int = 4) -> np.ndarray:
    own = vectors_to_matrices(rng.normal(0, 0.4, (frames, len(body.joints), 3)))
    return chain_turns(body.anatomy, own)


@pytest.fixture
def person(rng) -> Body:
    return draw_sculpted("rounded", rng)


@pytest.mark.parametrize("family", ["rounded", "horse"])
def test_an_avatar_of_known_parts_plays_its_poses_again(family, rng):
    body = draw_sculpted(family, rng)
    poses = pose_body(body, random_turns(body, rng), rng.normal(0, 0.1, (4, 3)))
    rigged = rig_avatar(body.mesh, poses, known(body), times=np.arange(4) / 24)
    off = np.linalg.norm(play_clip(rigged, rigged.clips[0]) - poses, axis=-1)
    assert off.mean() < 0.004 and rigged.skeleton.names == body.anatomy.names


def test_a_rest_pose_is_static(person):
    poses = np.stack([person.mesh.vertices] * 2)
    rigged = rig_avatar(person.mesh, poses, known(person), times=np.arange(2.0))
    assert np.abs(play_clip(rigged, rigged.clips[0]) - poses).max() < 1e-6


def test_rigid_parts_turn_as_they_were_turned(person, rng):
    hard = np.eye(len(person.joints))[person.weights.argmax(axis=1)]
    turns = random_turns(person, rng)
    rigid = dataclasses.replace(person, weights=hard)
    found, _ = rigid_parts(
        person.mesh.vertices, pose_body(rigid, turns), hard, PERSON.parents, prior=1e-9
    )
    large = hard.mean(axis=0) > 0.01
    assert np.abs(found - turns)[:, large].max() < 1e-3


def test_joints_go_back_to_where_the_motion_says_they_are(person, rng):
    turns = random_turns(person, rng, frames=6)
    motion = pose_motion(person.joints, PERSON.parents, turns)
    off = person.joints + rng.normal(0, 0.03, person.joints.shape)
    settled = settle_joints(off, PERSON.parents, turns, motion[..., :3, 3], held=1e-6)
    assert np.abs(settled - person.joints)[1:].max() < 1e-3
    still = np.broadcast_to(np.eye(3), turns.shape)
    kept = settle_joints(off, PERSON.parents, still, np.zeros(motion[..., :3, 3].shape))
    assert np.array_equal(kept, off)


def test_vertices_of_a_wrong_part_are_found_by_their_motion(person, rng):
    turns = random_turns(person, rng)
    motion = pose_motion(person.joints, PERSON.parents, turns)
    poses = pose_body(person, turns)
    hand = person.weights[:, PERSON.index("leftHand")] > 0.99
    wrong = person.weights.copy()
    wrong[hand] = np.eye(len(PERSON.names))[PERSON.index("head")]
    seen = dataclasses.replace(known(person), weights=wrong)
    mended = mend_weights(person.mesh, poses, seen, turns, motion[..., :3, 3])
    assert (mended[hand].argmax(axis=1) == PERSON.index("leftHand")).mean() > 0.9
    assert np.array_equal(mended[~hand], wrong[~hand])


def test_arms_hanging_against_a_t_pose_are_pose_and_short_arms_are_not(person):
    hanging = vary_body(person, chain_turns(PERSON, arm_turns(person.joints, PERSON, 70.0)))
    turns = rest_difference(known(person), known(hanging))
    arm = PERSON.index("leftUpperArm")
    bone = person.joints[PERSON.index("leftHand")] - person.joints[arm]
    theirs = hanging.joints[PERSON.index("leftHand")] - hanging.joints[arm]
    turned = turns[arm] @ bone
    cosine = turned @ theirs / np.linalg.norm(turned) / np.linalg.norm(theirs)
    assert cosine > 0.99
    near = vary_body(person, chain_turns(PERSON, arm_turns(person.joints, PERSON, 10.0)))
    assert np.abs(rest_difference(known(person), known(near)) - np.eye(3)).max() < 1e-9

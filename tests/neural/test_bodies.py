import dataclasses

import numpy as np
import pytest

from bunraku.meshes import signed_volume
from bunraku.neural.accessories import dress_up
from bunraku.neural.anatomy import PERSON
from bunraku.neural.bodies import check_body, joint_gaps, pose_body, pose_motion, sample_cloud
from bunraku.neural.corpus import draw_sculpted
from bunraku.neural.sculpted_people import FAMILIES, sculpt_person
from bunraku.neural.sculpted_quadrupeds import SPECIES
from bunraku.neural.solids import Share, place_solid, ramp_weights, unit_solid
from bunraku.neural.variation import (
    arm_turns,
    chain_turns,
    rest_turns,
    scale_parts,
    vary,
    vary_body,
)
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Mesh


@pytest.mark.parametrize("family", [*FAMILIES, *SPECIES])
def test_sculpted_bodies_are_what_they_claim_to_be(family, rng):
    for _ in range(5):
        body = draw_sculpted(family, rng)
        check_body(body)
        assert np.isclose(np.ptp(body.mesh.vertices, axis=0).max(), 1.0)
        assert signed_volume(body.mesh.vertices, body.mesh.faces) > 0


def test_the_check_sees_a_joint_in_the_wrong_place(rng):
    body = draw_sculpted("rounded", rng)
    joints = body.joints.copy()
    joints[PERSON.index("leftHand")] = body.joints[PERSON.index("rightFoot")]
    with pytest.raises(AssertionError):
        check_body(dataclasses.replace(body, joints=joints))
    assert joint_gaps(body)[PERSON.index("leftHand")] < 0.1


def test_turning_one_arm_moves_only_what_hangs_on_it(rng):
    body = sculpt_person("rounded", rng)
    own = np.tile(np.eye(3), (len(PERSON.names), 1, 1))
    own[PERSON.index("leftUpperArm")] = vectors_to_matrices(np.array([0, 0, 0.5]))
    moved = pose_body(body, chain_turns(PERSON, own))
    still = body.weights[
        :, [PERSON.index(f"left{n}") for n in ("UpperArm", "LowerArm", "Hand")]
    ].sum(axis=1)
    off = np.linalg.norm(moved - body.mesh.vertices, axis=1)
    assert off[still == 0].max() < 1e-12 and off[still > 0.99].max() > 0.05


def test_parts_stay_together_at_their_joints(rng):
    body = draw_sculpted("dog", rng)
    parents = body.anatomy.parents
    motion = pose_motion(body.joints, parents, rest_turns(body.joints, body.anatomy, rng))
    for part, parent in enumerate(parents[1:], start=1):
        ends = [(motion[k] @ np.append(body.joints[part], 1))[:3] for k in (part, parent)]
        assert np.allclose(*ends)


def test_a_solid_is_closed_faces_outwards_and_passes_from_part_to_part():
    vertices, faces = unit_solid(1.0, 0.0)
    assert abs(signed_volume(vertices, faces) / (4 / 3 * np.pi) - 1) < 0.15
    share = Share((0, 1), (0.5,), 0.2)
    weights = ramp_weights(np.array([0.0, 0.5, 0.55, 1.0]), share)
    assert np.allclose(weights, [[1, 0], [0.5, 0.5], [0.25, 0.75], [0, 1]])
    ends = np.array([[0.0, 0, 0], [0, 2.0, 0]])
    solid = place_solid(ends, (0.5, 0.5), share, 3)
    assert np.allclose(np.ptp(solid.vertices, axis=0), [1, 2, 1], atol=0.05)
    assert (solid.weights[:, 2] == 0).all()


def test_what_is_worn_follows_one_part(rng):
    body = sculpt_person("rounded", rng)
    dressed = [dress_up(body, rng) for _ in range(5)]
    for one in dressed:
        worn = one.weights[len(body.weights) :]
        assert ((worn == 0) | (worn == 1)).all()
    assert max(len(one.weights) for one in dressed) > len(body.weights)


def test_arms_fall_as_far_as_asked(rng):
    body = sculpt_person("rounded", rng)
    fallen = vary_body(body, chain_turns(PERSON, arm_turns(body.joints, PERSON, 45.0)))
    upper, hand = (fallen.joints[PERSON.index(f"left{n}")] for n in ("UpperArm", "Hand"))
    bone = hand - upper
    assert np.isclose(np.degrees(np.arctan2(-bone[1], bone[0])), 45.0)


def test_scaled_parts_keep_joints_with_their_surface(rng):
    for _ in range(5):
        body = draw_sculpted("rounded", rng)
        scaled = vary_body(body, scale_parts(body.joints, PERSON, rng))
        check_body(scaled)
        twins = PERSON.twins
        lengths = np.linalg.norm(scaled.joints - scaled.joints[PERSON.parents], axis=1)[1:]
        assert np.allclose(lengths, lengths[twins[1:] - 1], atol=1e-6)


def test_variants_keep_labels_at_their_points(rng):
    """A nearest-neighbour look-up by part tells a variant's joints from anything else."""
    body = draw_sculpted("horse", rng)
    cloud = sample_cloud(body, 600, rng)
    variant = vary(cloud, rng)
    assert np.allclose(np.linalg.norm(variant.normals, axis=1), 1.0)
    assert np.allclose(np.sort(variant.weights.sum(axis=0)).sum(), 600)
    used = dataclasses.replace(
        body, mesh=Mesh(variant.points, np.zeros((0, 3), np.int64)), weights=variant.weights,
        joints=variant.joints,
    )  # fmt: skip
    assert np.nanmax(joint_gaps(used)) < 0.35

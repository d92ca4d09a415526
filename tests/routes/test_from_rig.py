from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from trimesh.creation import torus

from bunraku.formats import read_character, read_figure, write_character, write_mesh
from bunraku.meshes import closest_points, interpolate, sample_surface
from bunraku.rotations import rotation_angles
from bunraku.routes import from_rig
from bunraku.routes.from_rig import RigTransfer, animate_from_rig
from bunraku.skinning import (
    clip_transforms,
    forward_kinematics,
    linear_blend_skinning,
    play_clip,
)
from bunraku.types import Character, MatchError, Mesh
from tests.creatures import JOINTS, NAMES, make_creature, move, pose_of, true_weights, world_pose

SIZE = 1.7
LEFT = Rotation.from_euler("y", 90, degrees=True).as_matrix()
POSE = {
    "leftArm": (0.0, 0.0, 40.0),
    "rightArm": (0.0, 30.0, 0.0),
    "leftLeg": (-30.0, 0.0, 0.0),
    "head": (0.0, 25.0, 0.0),
}


def stand(points: np.ndarray) -> np.ndarray:
    """Bring points of the other creature to where the figure stands: larger, and facing left."""
    return SIZE * points @ LEFT.T


def off(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Give distances in metres of a figure 1.1 m high."""
    return np.linalg.norm(found - truth, axis=-1) / SIZE


@pytest.fixture(scope="module")
def other() -> Character:
    """The creature with other triangles, whose true skin, joints and motion are known."""
    return make_creature(0.028)


@pytest.fixture(scope="module")
def figure(other) -> Mesh:
    """The other creature, larger, facing left and frozen in a pose."""
    return Mesh(stand(move(other, world_pose(other.skeleton, pose_of(POSE)))), other.mesh.faces)


@pytest.fixture(scope="module")
def transfer(creature, figure) -> RigTransfer:
    return animate_from_rig(creature, figure)


def test_the_figure_is_understood(transfer):
    assert transfer.confidence > 0.9 and not transfer.mirrored and not transfer.warnings
    np.testing.assert_allclose(transfer.reposed.heading, LEFT, atol=1e-9)
    assert transfer.reposed.posed > 0.5


def test_the_figure_is_given_back_as_found(transfer, figure):
    character = transfer.character
    assert character.mesh is figure
    bound = forward_kinematics(character.skeleton.parents, character.skeleton.rest)
    np.testing.assert_allclose(move(character, bound), figure.vertices, atol=1e-9)


def test_it_gets_the_sources_joints_and_clips(transfer, creature):
    assert transfer.character.skeleton.names == transfer.rested.names == NAMES
    np.testing.assert_array_equal(transfer.character.skeleton.parents, creature.skeleton.parents)
    (carried,), (clip,) = transfer.character.clips, creature.clips
    assert carried.name == clip.name
    np.testing.assert_array_equal(carried.times, clip.times)


def test_weights_are_near_the_truth(transfer, other):
    found, truth = transfer.character.skin.weights, other.skin.weights
    assert (100 * ((found - truth) ** 2).mean(axis=0)).max() < 0.1  # measured .02
    assert (found.argmax(axis=1) == truth.argmax(axis=1)).mean() > 0.98  # measured .994
    assert ((found > 0).sum(axis=1) <= 4).all()


def test_joints_are_near_the_truth(transfer, other):
    truth = stand(world_pose(other.skeleton, pose_of(POSE))[:, :3, 3])
    assert off(transfer.reposed.found, truth).max() < 0.02  # measured .008


def test_joint_frames_are_near_the_truth(transfer, other):
    """Twist included; a round arm shows none of its own."""
    truth = LEFT @ world_pose(other.skeleton, pose_of(POSE))[:, :3, :3]
    bind = forward_kinematics(transfer.character.skeleton.parents, transfer.character.skeleton.rest)
    wrong = np.rad2deg(rotation_angles(np.swapaxes(truth, 1, 2) @ bind[:, :3, :3]))
    arms = np.array(["Arm" in name for name in NAMES])
    assert wrong[~arms].max() < 6 and wrong[arms].max() < 30  # measured 2.6 and 14.7


def test_the_way_to_rest_brings_the_figure_to_rest(transfer, figure, other):
    weights = transfer.character.skin.weights
    rested = linear_blend_skinning(figure.vertices, weights, transfer.repose_motion)
    wrong = off(rested, stand(other.mesh.vertices))
    assert wrong.mean() < 0.015 and wrong.max() < 0.06  # measured .006 and .022
    again = forward_kinematics(transfer.rested.parents, transfer.rested.rest)
    np.testing.assert_allclose(move(transfer.character, again), rested, atol=1e-9)


def test_clips_play_as_they_do_on_the_source(transfer, other):
    """Every vertex against the truth: the other creature played by the clip, then stood there."""
    clip = transfer.character.clips[0]
    truth = stand(play_clip(other, other.clips[0]))
    wrong = off(play_clip(transfer.character, clip), truth)
    assert wrong.mean() < 0.015 and wrong.max() < 0.06  # measured .006 and .022
    travel = off(truth, truth[:1])[-1].mean()
    assert travel > 0.4  # a frozen figure would be far off


def test_world_turns_of_a_clip_are_the_sources_own(transfer, creature):
    world, truth = (
        forward_kinematics(who.skeleton.parents, clip_transforms(who.clips[0]))[..., :3, :3]
        for who in (transfer.character, creature)
    )
    np.testing.assert_allclose(world, LEFT @ truth, atol=1e-6)


def test_the_registered_source_lies_on_the_figure(transfer, figure):
    distance = closest_points(transfer.registration.fitted, figure.vertices, figure.faces)[2]
    assert distance.mean() / SIZE < 0.005


def test_seconds_of_every_stage_are_kept(transfer):
    stages = ["proxy", "registration", "skin and skeleton", "rest pose", "retargeting"]
    assert list(transfer.seconds) == stages
    assert min(transfer.seconds.values()) > 0


def test_the_same_input_gives_the_same_result_and_only_the_chosen_clips(transfer, creature, figure):
    clip = replace(creature.clips[0], name="Again")
    again = animate_from_rig(creature, figure, clips=[clip])
    assert [clip.name for clip in again.character.clips] == ["Again"]
    np.testing.assert_array_equal(again.character.skin.weights, transfer.character.skin.weights)
    np.testing.assert_array_equal(again.repose_motion, transfer.repose_motion)
    np.testing.assert_array_equal(
        again.character.clips[0].rotations, transfer.character.clips[0].rotations
    )


@pytest.fixture(scope="module")
def ring() -> Mesh:
    """Something that is no creature."""
    shape = torus(1.0, 0.08, major_sections=48, minor_sections=8)
    return Mesh(np.array(shape.vertices), np.array(shape.faces, np.int64))


@pytest.fixture(scope="module")
def forced(creature, ring) -> RigTransfer:
    return animate_from_rig(replace(creature, clips=()), ring, force=True)


def test_a_figure_of_another_kind_can_be_forced_by_a_source_without_clips(forced):
    assert forced.confidence < 0.05 and forced.warnings and forced.character.clips == ()
    assert np.isfinite(forced.repose_motion).all()


def test_a_figure_of_another_kind_is_refused(creature, ring, forced, monkeypatch):
    """By what the forced run has found, to save finding it again."""
    found = forced.registration, ()
    monkeypatch.setattr(from_rig, "register_with_landmarks", lambda *_: found)
    with pytest.raises(MatchError, match="the figure does not fit the performance"):
        animate_from_rig(creature, ring)


def test_a_scan_without_faces_goes_the_same_way(creature, rng, tmp_path):
    """From a file of points to a file of moving points, with about the skin of the formula."""
    face, shares = sample_surface(creature.mesh.vertices, creature.mesh.faces, 6000, rng)
    points = interpolate(creature.mesh.vertices, creature.mesh.faces[face], shares)
    write_mesh(tmp_path / "scan.ply", Mesh(points, np.zeros((0, 3), np.int64)))
    scan = read_figure(tmp_path / "scan.ply")
    found = animate_from_rig(creature, scan.mesh)
    error = found.character.skin.weights - true_weights(scan.mesh.vertices)
    assert np.abs(error).sum(axis=1).mean() / 2 < 0.06
    assert np.linalg.norm(found.reposed.found - JOINTS, axis=1).max() < 0.06
    write_character(tmp_path / "moving.glb", scan, found.character)
    back = read_character(tmp_path / "moving.glb")
    assert len(back.mesh.vertices) == 6000 and len(back.mesh.faces) == 0
    frames = play_clip(back, back.clips[0], slice(None, None, 3))
    expected = play_clip(found.character, found.character.clips[0], slice(None, None, 3))
    np.testing.assert_allclose(frames, expected, atol=1e-3)

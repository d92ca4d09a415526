from dataclasses import replace

import numpy as np
import pytest

from bunraku.meshes import scale_to_unit_area
from bunraku.registration.articulated import (
    COARSE,
    FINE,
    LARGEST_STEP,
    Stage,
    add_priors,
    apply_step,
    fit,
    fit_error,
    gauss_newton_step,
    motion_jacobian,
)
from bunraku.registration.correspondence import Surface, make_surface, pin
from bunraku.registration.puppet import Pose, move_puppet, rest_pose
from bunraku.rotations import rotation_angles, vectors_to_matrices
from tests.creatures import NAMES, make_creature, move, pose_of, world_pose

ANGLES = {
    "chest": (0.0, 15.0, 0.0),
    "head": (20.0, 0.0, 0.0),
    "leftArm": (0.0, 0.0, 35.0),
    "rightArm": (0.0, -30.0, 0.0),
    "leftLeg": (-35.0, 0.0, 0.0),
}


def degrees_between(puppet, one: Pose, other: Pose) -> np.ndarray:
    difference = np.swapaxes(one.world(puppet)[0], 1, 2) @ other.world(puppet)[0]
    return np.rad2deg(rotation_angles(difference))


def test_the_jacobian_agrees_with_finite_differences_of_a_step(puppet, somehow):
    """Every turn, scale along, scale across and root shift, in a random pose."""
    chosen = puppet.samples[:40]
    jacobian, moved = motion_jacobian(puppet, somehow, chosen)
    np.testing.assert_allclose(moved, move_puppet(puppet, somehow, chosen)[0], atol=1e-12)
    step = 1e-6
    for column in range(jacobian.shape[2]):
        change = np.zeros(jacobian.shape[2])
        change[column] = step
        ahead, _ = move_puppet(puppet, apply_step(puppet, somehow, change), chosen)
        back, _ = move_puppet(puppet, apply_step(puppet, somehow, -change), chosen)
        difference = (ahead - back) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, column], difference, atol=1e-8)


def test_a_step_changes_no_unknown_by_more_than_the_largest(puppet):
    count = len(puppet.parents)
    pose = apply_step(puppet, rest_pose(puppet), np.linspace(-50, 50, 5 * count + 3))
    assert np.isclose(np.abs(pose.root - puppet.anchors[0]).max(), LARGEST_STEP)
    assert np.abs(pose.scales).max() <= LARGEST_STEP + 1e-12


def test_priors_alone_lead_back_to_rest_in_one_step(puppet, rng):
    """They are quadratic in turns and scales; the root's turn and place cost nothing."""
    count = len(puppet.parents)
    small = vectors_to_matrices(rng.normal(scale=0.1, size=(count, 3)))
    pose = Pose(puppet.anchors[0], small, rng.normal(scale=0.1, size=(count, 2)))
    hessian, gradient = np.zeros((5 * count + 3,) * 2), np.zeros(5 * count + 3)
    stage = Stage(1, 1, 0.1, 0.1, 0.1, 1.0, 1.0)
    add_priors(hessian, gradient, puppet, pose, stage, rest_pose(puppet))
    rested = apply_step(puppet, pose, np.linalg.solve(hessian, gradient))
    np.testing.assert_allclose(
        rested.rotations[1:], np.tile(np.eye(3), (count - 1, 1, 1)), atol=1e-6
    )
    np.testing.assert_allclose(rested.rotations[0], pose.rotations[0], atol=1e-6)
    np.testing.assert_allclose(rested.scales, 0, atol=1e-5)
    np.testing.assert_allclose(rested.root, pose.root)


def test_the_pose_called_home_costs_nothing(puppet, somehow):
    count = len(puppet.parents)
    hessian, gradient = np.zeros((5 * count + 3,) * 2), np.zeros(5 * count + 3)
    stage = Stage(1, 1, 0.1, 0.1, 0.1, 1.0, 1.0)
    add_priors(hessian, gradient, puppet, somehow, stage, somehow)
    np.testing.assert_allclose(gradient, 0, atol=1e-12)
    add_priors(hessian, gradient, puppet, somehow, stage, rest_pose(puppet))
    assert np.abs(gradient).max() > 0.1


def test_scales_cost_more_the_less_they_are_like_the_parents(puppet):
    count = len(puppet.parents)

    def cost_of(scales: np.ndarray) -> float:
        pose = replace(rest_pose(puppet), scales=scales)
        hessian, gradient = np.zeros((5 * count + 3,) * 2), np.zeros(5 * count + 3)
        stage = Stage(1, 1, 0.1, 0.1, 0.1, 1.0, 1.0)
        add_priors(hessian, gradient, puppet, pose, stage, rest_pose(puppet))
        return float(-gradient[3 * count : 5 * count] @ scales.T.ravel())

    whole = np.full((count, 2), 0.3)
    alone, uneven = np.zeros((count, 2)), whole * [1.0, -1.0]
    alone[1] = 0.3
    assert cost_of(np.zeros((count, 2))) == 0 < cost_of(alone)
    assert cost_of(whole) < cost_of(uneven)
    mixed = np.where(np.arange(count)[:, None] % 2, 0.3, -0.3) * np.ones(2)
    assert cost_of(whole) < cost_of(mixed)


def test_steps_with_the_right_pairs_recover_turns_and_scales(puppet, rng):
    count = len(puppet.parents)
    truth = Pose(
        puppet.anchors[0] + [0.1, -0.2, 0.05],
        vectors_to_matrices(rng.normal(scale=0.3, size=(count, 3))),
        np.tile(rng.normal(scale=0.1, size=(count, 1)), (1, 2)),
    )
    goal, _ = move_puppet(puppet, truth)
    surface, samples = make_surface(goal, puppet.faces), puppet.samples[:600]
    pairs = pin(samples, samples, 1.0)
    pose = rest_pose(puppet)
    for _ in range(12):
        stage = replace(COARSE[0], width=1.0, points=1.0, turns=1e-9, scales=1e-9)
        pose = gauss_newton_step(puppet, pose, surface, pairs, stage)
    moved, _ = move_puppet(puppet, pose)
    assert degrees_between(puppet, pose, truth).max() < 0.05
    seen = puppet.axes.any(axis=1)  # without an axis there is nothing to scale along
    assert np.abs(pose.scales - truth.scales)[:, 1].max() < 1e-3
    assert np.abs(pose.scales - truth.scales)[seen, 0].max() < 1e-3
    assert np.abs(moved - goal).max() < 1e-4


@pytest.fixture(scope="module")
def fitted(puppet, creature) -> tuple[Surface, Pose]:
    """The puppet fitted to the creature in another pose, with other triangles."""
    other = make_creature(0.028)
    posed = move(other, world_pose(other.skeleton, pose_of(ANGLES)))
    _, centre, scale = scale_to_unit_area(creature.mesh.vertices, creature.mesh.faces)
    surface = make_surface((posed - centre) / scale, other.mesh.faces)
    return surface, fit(puppet, rest_pose(puppet), surface, COARSE + FINE)


def test_a_fit_recovers_a_known_pose_on_other_triangles(puppet, fitted):
    _, pose = fitted
    truth = replace(rest_pose(puppet), rotations=pose_of(ANGLES)[puppet.joints])
    arms = np.isin(puppet.joints, [NAMES.index("leftArm"), NAMES.index("rightArm")])
    assert degrees_between(puppet, pose, truth)[~arms].max() < 5  # measured 2.1
    # an arm is round: its turn about itself cannot be seen, its direction can
    directions = [np.einsum("jab,jb->ja", p.world(puppet)[0], puppet.axes) for p in (pose, truth)]
    cosine = np.einsum("ja,ja->j", *directions)[arms]
    assert np.rad2deg(np.arccos(cosine)).max() < 3
    assert np.abs(pose.scales).max() < 0.05


def test_a_fit_lowers_the_misfit(puppet, fitted):
    surface, pose = fitted
    start = rest_pose(puppet)
    assert fit_error(puppet, pose, surface) < 0.3 * fit_error(puppet, start, surface)

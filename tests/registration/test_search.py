from dataclasses import replace

import numpy as np
import pytest

from bunraku.meshes import closest_points, interpolate
from bunraku.registration.articulated import fit_error
from bunraku.registration.correspondence import make_surface
from bunraku.registration.moments import no_moments
from bunraku.registration.puppet import move_puppet, rest_pose
from bunraku.registration.search import (
    Candidate,
    Registration,
    distinct,
    doubt,
    find_candidates,
    fitting_puppet,
    free_from_rig,
    heading_starts,
    likely_moments,
    mapped_candidate,
    posed_start,
    refit,
    register_body,
    settle,
)
from bunraku.rotations import rotation_angles, vectors_to_matrices
from bunraku.skeletons import fit_similarities
from bunraku.skinning import clip_transforms, forward_kinematics, play_clip
from bunraku.types import Mesh
from tests.creatures import make_creature, move, pose_of, world_pose

TURN = vectors_to_matrices(np.array([0.0, np.deg2rad(125), 0.0]))
POSE = {"leftArm": (0.0, 0.0, 40.0), "rightLeg": (-30.0, 0.0, 0.0), "head": (0.0, 25.0, 0.0)}


def test_headings_start_ahead_and_go_round_in_equal_steps(puppet):
    starts = heading_starts(puppet, 4)
    ahead = np.array([start.rotations[0] @ [0.0, 0, 1] for start in starts])
    np.testing.assert_allclose(ahead, [[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(move_puppet(puppet, starts[0])[0], puppet.vertices, atol=1e-12)


def test_a_posed_start_stands_as_the_source_does_at_that_moment(creature, puppet):
    clip, skeleton = creature.clips[0], creature.skeleton
    frame = 5
    world = forward_kinematics(skeleton.parents, clip_transforms(clip))[frame]
    at_rest = forward_kinematics(skeleton.parents, skeleton.rest)
    turns = world[:, :3, :3] @ np.swapaxes(at_rest[:, :3, :3], 1, 2)
    moved, _ = move_puppet(puppet, posed_start(puppet, turns, TURN))
    played = play_clip(creature, clip)[frame] @ TURN.T
    scale = np.ptp(puppet.vertices[:, 1]) / np.ptp(creature.mesh.vertices[:, 1])
    moved, played = moved - moved.mean(axis=0), scale * (played - played.mean(axis=0))
    np.testing.assert_allclose(moved, played, atol=1e-9)


def test_a_stretched_fit_forgets_how_the_clips_turn_joints(body):
    pose = rest_pose(body.puppet)
    assert (body.puppet.stiffness != np.eye(3)).any()
    assert fitting_puppet(body.puppet, Candidate(pose, None, 0.1)) is body.puppet
    free = fitting_puppet(body.puppet, Candidate(pose, pose, 0.1))
    np.testing.assert_array_equal(free.stiffness, np.tile(np.eye(3), (len(free.joints), 1, 1)))


def test_starts_that_led_to_one_place_are_tried_once(puppet):
    ahead, aside, behind, *_ = (Candidate(p, None, 0.1) for p in heading_starts(puppet, 4))
    nearly = Candidate(rest_pose(puppet, vectors_to_matrices(np.array([0, 0.01, 0]))), None, 0.1)
    assert distinct(puppet, [ahead, nearly, aside, behind]) == [ahead, aside]
    assert distinct(puppet, [nearly, ahead]) == [nearly]


def test_the_moment_that_the_figure_is_frozen_in_is_found(body):
    puppet = body.puppet
    about = heading_starts(puppet)[4].rotations[0]
    vertices, _ = move_puppet(puppet, posed_start(puppet, body.moments.turns[0], about))
    surface = make_surface(vertices + 1.0, puppet.faces)  # wherever it stands
    likely = likely_moments(body, surface, [np.eye(3), about], keep=3)
    assert len(likely) == 3
    np.testing.assert_allclose(
        likely[0].world(puppet)[0][0], about @ body.moments.turns[0, 0], atol=1e-6
    )
    moved, _ = move_puppet(puppet, likely[0])
    assert np.linalg.norm(moved - surface.vertices, axis=1).max() < 0.05
    assert not likely_moments(replace(body, moments=no_moments(len(body.joints))), surface, [about])


def turned_candidate(puppet, degrees: float, error: float) -> Candidate:
    turn = vectors_to_matrices(np.array([0.0, np.deg2rad(degrees), 0.0]))
    return Candidate(rest_pose(puppet, turn), None, error)


def test_doubt_grows_with_the_misfit_and_breaks_ties_for_the_front(puppet):
    ahead, behind = (turned_candidate(puppet, degrees, 0.1) for degrees in (0, 180))
    assert doubt(ahead) < doubt(turned_candidate(puppet, 0, 0.2))
    assert doubt(ahead) < doubt(behind)
    assert doubt(turned_candidate(puppet, 180, 0.05)) < doubt(ahead)  # it may fit much better


def test_the_source_is_found_whichever_way_the_figure_faces(body):
    puppet = body.puppet
    surface = make_surface(puppet.vertices @ TURN.T, puppet.faces)
    found = find_candidates(body, Mesh(surface.vertices, surface.faces), surface)
    best = found[0]
    assert [doubt(candidate) for candidate in found] == sorted(map(doubt, found))
    assert best.error < 0.02 and np.isclose(fit_error(puppet, best.pose, surface), best.error)
    assert np.rad2deg(rotation_angles(TURN.T @ best.pose.rotations[0])) < 2


def test_refitting_to_the_rigs_own_surface_recovers_the_pose(puppet):
    truth = replace(rest_pose(puppet, TURN), scales=np.full((7, 2), 0.05))
    truth = replace(truth, rotations=truth.rotations @ pose_of(POSE)[puppet.joints])
    vertices, _ = move_puppet(puppet, truth)
    pose = refit(puppet, rest_pose(puppet, TURN), vertices)
    assert np.linalg.norm(move_puppet(puppet, pose)[0] - vertices, axis=1).mean() < 1e-3


def test_a_settled_rig_turns_where_its_blended_surface_only_half_does(puppet):
    """Legs that spread drag the hips' soft skin along, which then seems to have turned."""
    apart = np.linalg.norm(puppet.vertices[:, None] - puppet.vertices, axis=2)
    near = np.exp(-((apart / 0.08) ** 2)) * puppet.areas
    soft = replace(puppet, weights=near @ puppet.weights / near.sum(axis=1)[:, None])
    truth = pose_of({"leftLeg": (-80.0, 0.0, 0.0), "rightLeg": (-40.0, 0.0, 0.0)})[soft.joints]
    vertices, _ = move_puppet(soft, replace(rest_pose(soft), rotations=truth))
    own = soft.areas[:, None] * soft.weights**2
    surfaces, *_ = fit_similarities(soft.vertices, vertices, own)
    half = refit(soft, rest_pose(soft), vertices)  # held back by costs that nothing is left for
    found = [surfaces, half.world(soft)[0], settle(soft, half, vertices).world(soft)[0]]
    wrong = [np.rad2deg(rotation_angles(np.swapaxes(truth, 1, 2) @ t).max()) for t in found]
    assert wrong[2] < wrong[0] / 3 and wrong[2] < wrong[1] / 3


def test_freeing_the_surface_meets_what_the_rig_alone_cannot(puppet):
    """A belly that no turn and no scale of the bones makes."""
    low = np.exp(-((puppet.vertices - puppet.anchors[0] - [0, 0, 0.12]) ** 2).sum(axis=1) / 0.01)
    goal = puppet.vertices + 0.03 * low[:, None] * [0.0, 0.0, 1.0]
    surface = make_surface(goal, puppet.faces)
    pose, freed = free_from_rig(puppet, rest_pose(puppet), surface)
    rigged, _ = move_puppet(puppet, pose)
    belly = low > 0.5
    off = [closest_points(v[belly], goal, puppet.faces)[2].mean() for v in (rigged, freed)]
    assert off[0] > 0.005 > 0.001 > off[1]


@pytest.fixture(scope="module")
def registered(body) -> tuple[Registration, Mesh, np.ndarray]:
    """A turned, posed, scaled copy with other triangles; and its own rest surface."""
    other = make_creature(0.029)
    posed = move(other, world_pose(other.skeleton, pose_of(POSE)))
    figure = Mesh(1.7 * posed @ TURN.T + [3.0, 1.0, -2.0], other.mesh.faces)
    return register_body(body, figure), figure, other.mesh.vertices


def test_registration_brings_every_vertex_to_its_place(body, registered):
    found, figure, other_rest = registered
    face, shares, distance = closest_points(found.fitted, figure.vertices, figure.faces)
    assert distance.mean() < 0.01 and found.error < 0.15
    came_from = interpolate(other_rest, figure.faces[face], shares)
    wrong = np.linalg.norm(came_from - body.proxy.mesh.vertices, axis=1)
    assert np.median(wrong) < 0.01 and wrong.mean() < 0.02 and (wrong > 0.1).mean() < 0.005


def test_registration_names_the_misfits_of_the_other_starts(registered):
    found, _, _ = registered
    assert found.others and min(found.others) >= found.error


def registration_of(puppet, misfit: float) -> Registration:
    return Registration(rest_pose(puppet), puppet.vertices, puppet.anchors, misfit, ())


@pytest.mark.parametrize(("misfit", "confidence"), [(0.0, 1.0), (0.1, 0.984), (0.28, 0.5)])
def test_confidence_by_hand(puppet, misfit, confidence):
    assert abs(registration_of(puppet, misfit).confidence - confidence) < 0.005


def test_a_poor_fit_is_said(puppet):
    assert registration_of(puppet, 0.1).doubts == ()
    (said,) = registration_of(puppet, 0.4).doubts
    assert "strain 0.40" in said


def test_a_lying_figure_starts_from_the_functional_map(body):
    """No heading about the vertical comes near it."""
    lying = vectors_to_matrices(np.array([np.deg2rad(-85), 0.0, 0.0]))
    surface = make_surface(body.puppet.vertices @ lying.T, body.puppet.faces)
    found = mapped_candidate(body, Mesh(surface.vertices, surface.faces), surface)
    assert found.error < 0.1 and found.home is None
    assert np.rad2deg(rotation_angles(lying.T @ found.pose.rotations[0])) < 5


def test_a_figure_that_stands_as_the_source_is_found_at_rest_and_a_posed_one_is_not(body, creature):
    still = body.proxy.mesh
    raised = world_pose(creature.skeleton, pose_of({"leftArm": (0.0, 0.0, 60.0)}))
    assert register_body(body, still).at_rest
    moved = Mesh(move(creature, raised), creature.mesh.faces)
    assert not register_body(body, moved).at_rest


def test_joints_at_rest_are_the_sources(body):
    found = register_body(body, body.proxy.mesh)
    np.testing.assert_allclose(found.joints, body.joints, atol=0.01)

import dataclasses

import numpy as np
import pytest

from bunraku import builtin
from bunraku.evaluate import pose, pose_tasks
from bunraku.evaluate.deformation_transfer import (
    face_maps,
    nearest_offset,
    nearest_triangles,
    transfer_deformation,
)
from bunraku.evaluate.metrics import pose_distance
from bunraku.evaluate.part_truth import merge_spine, true_joints, true_parts
from bunraku.neural.anatomy import PERSON
from bunraku.neural.bodies import pose_body
from bunraku.neural.corpus import draw_sculpted
from bunraku.neural.parts import Understanding
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Mesh


@pytest.fixture(scope="module")
def task():
    """A dog's poses for a hippo, which need neither anny nor torch."""
    rng = np.random.default_rng(0)
    turns = pose_tasks.quadruped_turns(rng)
    bodies = draw_sculpted("dog", rng), draw_sculpted("hippo", rng)
    return pose_tasks._task("hippos", "dog>hippo", 0, bodies, (turns, turns), None)


def test_a_triangle_turned_is_mapped_by_that_turn(cube):
    turn = vectors_to_matrices(np.array([0.3, -0.2, 0.5]))
    maps = face_maps(cube.vertices, cube.vertices @ turn.T + 3.0, cube.faces)
    assert np.allclose(maps, turn)


def test_a_body_takes_its_own_poses_exactly(task):
    """The builder's check: true correspondence, near-zero error; rest is static."""
    avatar = task.avatar.mesh
    itself = np.arange(len(avatar.faces))
    moved = transfer_deformation(avatar, task.poses, avatar, corresponding=itself)
    assert pose_distance(moved, task.poses, 1.0) < 1e-3
    assert np.array_equal(nearest_triangles(avatar, avatar), itself)
    rest = avatar.vertices[None]
    assert pose_distance(transfer_deformation(avatar, rest, avatar), rest, 1.0) < 1e-3
    assert np.allclose(nearest_offset(avatar, task.poses, avatar), task.poses)


def test_a_box_moved_as_a_whole_moves_as_a_whole(cube):
    turn = vectors_to_matrices(np.array([0.0, 0.0, 0.4]))
    poses = (cube.vertices @ turn.T)[None]
    figure = Mesh(2.0 * cube.vertices, cube.faces)
    moved = transfer_deformation(cube, poses, figure)[0]
    shape = moved - moved.mean(axis=0)
    wanted = figure.vertices @ turn.T
    assert np.allclose(shape, wanted - wanted.mean(axis=0), atol=1e-4)


class Oracle:
    """Knows the parts of the task's avatar and figure."""

    def __init__(self, task):
        rng = np.random.default_rng(0)
        pose_tasks.quadruped_turns(rng)
        bodies = draw_sculpted("dog", rng), draw_sculpted("hippo", rng)
        self.bodies = {len(body.mesh.vertices): body for body in bodies}
        assert set(self.bodies) == {len(task.avatar.mesh.vertices), len(task.figure.vertices)}

    def __call__(self, mesh, *, kind=None):
        body = self.bodies[len(mesh.vertices)]
        return Understanding(body.kind, 1.0, body.weights, body.joints, 1.0)


def test_a_row_scores_every_method_and_the_oracle_wins(task):
    row = pose.measure(task, read=Oracle(task))
    methods = set(pose.METHODS) - {"registration"} - set(pose.PAPER)
    assert set(row.scores) >= methods and not row.failure and row.paper_parts is None
    assert row.scores["network"].pmd < 0.2 * row.scores["static"].pmd
    assert row.scores["network"].pmd < 0.5 * row.scores["nearest triangles"].pmd
    assert row.parts == 1.0 and row.key() == task.key()
    assert "hippos" in pose.describe(row) and pose.tabulate([row]).row_count == 1


def test_the_papers_form_gets_its_rows_if_it_is_there(task):
    """Asked with both surfaces and what the route understood of them."""

    @dataclasses.dataclass
    class Answer:
        frames: dict
        labels: np.ndarray
        seconds: float

    def still(avatar, poses, figure):
        assert avatar[0] is task.avatar.mesh and figure[0] is task.figure
        assert avatar[1].kind == figure[1].kind == "quadruped" and poses is task.poses
        moved = np.broadcast_to(task.figure.vertices, task.truth.shape)
        return Answer(dict.fromkeys(pose.PAPER, moved), task.parts, 2.0)

    row = pose.measure(task, read=Oracle(task), paper={"quadruped": still})
    assert row.scores["paper adapted"] == row.scores["static"]
    assert row.paper_parts == 1.0 and row.paper_seconds == 2.0
    other = pose.measure(task, read=Oracle(task), paper={"person": still})
    assert "paper" not in other.scores


def test_a_form_that_refuses_a_figure_leaves_the_other_methods(task, caplog):
    def refuse(avatar, poses, figure):
        raise ValueError("wanted the surface of a quadruped")

    row = pose.measure(task, read=Oracle(task), paper={"quadruped": refuse})
    assert not row.failure and "ours" in row.scores and "paper" not in row.scores
    assert row.paper_parts is None and "wanted the surface" in caplog.text


def test_a_reader_that_fails_leaves_a_row_that_says_so(task):
    def fail(mesh, *, kind=None):
        raise ValueError("broken")

    row = pose.measure(task, read=fail)
    assert row.failure == "broken" and "ours" not in row.scores
    assert "FAILED" in pose.describe(row)


def test_truth_and_avatar_are_posed_alike(task):
    static = pose.score(pose.baselines(task), task)["static"]
    assert static.pmd > 3 and static.els > 0.9
    rigged = pose._play(task.avatar)
    assert pose_distance(rigged, task.poses, 1.0) < 0.2  # four influences a vertex are kept


def test_the_parts_of_the_built_in_human_are_its_bones():
    human = builtin.human()
    parts, joints = true_parts(human), true_joints(human)
    assert np.isfinite(joints).all() and set(parts) <= set(range(20))
    head = human.mesh.vertices[parts == PERSON.index("head")]
    assert head[:, 1].min() > joints[PERSON.index("hips"), 1]


def test_parts_that_a_rig_has_not_count_as_their_ancestors():
    names = PERSON.index
    present = np.array([names("hips"), names("spine"), names("head")])
    labels = np.array([names("chest"), names("head"), names("leftHand")])
    assert merge_spine(labels, present).tolist() == [names("spine"), names("head"), names("spine")]


def test_human_poses_stand_on_the_stance_of_the_built_in_human():
    body = draw_sculpted("rounded", np.random.default_rng(1))
    turns, travel = pose_tasks.human_poses(np.random.default_rng(0))
    assert turns.shape == (pose_tasks.POSES, 20, 3, 3) and np.abs(travel).max() < 6
    standing = pose_tasks.stand(body, 45.0)
    moved = pose_body(standing, turns @ pose_tasks.human_stance(standing)[None])
    assert np.isfinite(moved).all()


def test_rows_are_told_apart_by_group_name_and_seed(task):
    other = dataclasses.replace(task, seed=1)
    assert other.key() != task.key()

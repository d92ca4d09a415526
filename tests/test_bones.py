import numpy as np
import pytest

from bunraku.bones.decomposition import decompose, joint_paths, neighbourhood, project_on_simplex
from bunraku.bones.splitting import (
    Bones,
    Piece,
    best_split,
    curves_of,
    fit_rigid,
    make_bones,
    merge_bones,
    node_moments,
    rigid_errors,
    split_curves,
    sum_moments,
)
from bunraku.curves import CurveSkeleton
from bunraku.rotations import vectors_to_matrices


@pytest.fixture
def finger(rng):
    """A tube along X around 21 nodes, bent about its middle, Z axis, further in every frame."""
    nodes = np.column_stack([np.linspace(0, 2, 21), np.zeros(21), np.zeros(21)])
    owners = np.repeat(np.arange(21), 12)
    angle = np.tile(np.arange(12) * np.pi / 6, 21)
    rest = nodes[owners] + 0.1 * np.column_stack(
        [np.zeros(len(angle)), np.cos(angle), np.sin(angle)]
    )
    bend = vectors_to_matrices(np.linspace(0, 1.2, 6)[:, None] * [0.0, 0.0, 1.0])
    far = rest[:, 0] > 1.0
    middle = np.array([1.0, 0.0, 0.0])
    paths = np.tile(rest, (6, 1, 1))
    paths[:, far] = np.einsum("fab,vb->fva", bend, rest[far] - middle) + middle
    edges = np.column_stack([np.arange(20), np.arange(1, 21)])
    return CurveSkeleton(nodes, edges, owners), rest, paths


def test_moments_give_the_error_of_the_best_rigid_motion(rng):
    rest, paths = rng.normal(size=(30, 3)), rng.normal(size=(4, 30, 3))
    owners = rng.integers(0, 3, 30)
    moments = node_moments(rest, paths, owners, 3)
    errors = rigid_errors(sum_moments(moments, np.array([[0, 1], [2, -1], [0, 2]])))
    for row, nodes in enumerate([(0, 1), (2,), (0, 2)]):
        mine = np.isin(owners, nodes)
        rotations, shifts = fit_rigid(rest[mine], paths[:, mine], np.ones(mine.sum()))
        moved = np.einsum("fab,vb->fva", rotations, rest[mine]) + shifts[:, None]
        plain = ((moved - paths[:, mine]) ** 2).sum(axis=(1, 2)).mean()
        assert errors[row] == pytest.approx(plain, rel=1e-6)


def test_a_curve_is_split_where_it_bends_and_nowhere_else(finger):
    skeleton, rest, paths = finger
    pieces = split_curves(skeleton, rest, paths)
    assert [(piece.path[0], piece.path[-1]) for piece in pieces] == [(0, 11), (11, 20)]
    assert [piece.own for piece in pieces] == [tuple(range(11)), tuple(range(11, 21))]
    still = np.tile(rest, (6, 1, 1))
    assert len(split_curves(skeleton, rest, still)) == 1
    noise = still + 1e-3 * np.random.default_rng(0).normal(size=still.shape)
    assert len(split_curves(skeleton, rest, noise)) == 1
    assert best_split(node_moments(rest, paths, skeleton.owners, 21), (0, 1, 2), 0.2, 0.0) is None


def test_bones_hang_together_parents_first(finger):
    skeleton, rest, paths = finger
    bones = make_bones(skeleton, split_curves(skeleton, rest, paths), rest)
    assert bones.parents.tolist() == [-1, 0]
    assert sorted(np.unique(bones.owners)) == [0, 1]
    assert abs(bones.joints[1, 0] - 1.05) < 0.1


def test_bones_that_move_alike_or_have_no_surface_go_to_their_parents(finger):
    skeleton, rest, paths = finger
    pieces = [
        Piece(tuple(range(6)), tuple(range(6))),
        Piece(tuple(range(5, 12)), tuple(range(6, 11))),
        Piece(tuple(range(11, 21)), tuple(range(11, 21))),
    ]
    bones = make_bones(skeleton, pieces, rest)
    assert len(bones.parents) == 3
    merged = merge_bones(bones, rest, paths)
    assert merged.parents.tolist() == [-1, 0]
    assert (np.bincount(merged.owners) == [11 * 12, 10 * 12]).all()
    few = Bones(bones.joints, bones.tips, bones.parents, np.minimum(bones.owners, 1), bones.rings)
    assert len(merge_bones(few, rest, paths).parents) == 2
    still = np.tile(rest, (6, 1, 1))
    assert len(merge_bones(bones, rest, still).parents) == 1


def test_curves_end_at_terminals_and_junctions():
    nodes = np.zeros((6, 3))
    edges = np.array([[0, 1], [1, 2], [2, 3], [2, 4], [4, 5]])
    curves = curves_of(CurveSkeleton(nodes, edges, np.zeros(1, np.int64)))
    assert sorted(sorted((c[0], c[-1])) for c in curves) == [[0, 2], [2, 3], [2, 5]]


def test_decomposition_explains_a_bent_tube_and_keeps_its_bones(finger):
    skeleton, rest, paths = finger
    bones = make_bones(skeleton, split_curves(skeleton, rest, paths), rest)
    weights, rotations, shifts = decompose(rest, paths, bones.owners, bones.parents)
    moved = np.einsum("fbac,vc->fbva", rotations, rest) + shifts[:, :, None]
    blended = np.einsum("vb,fbva->fva", weights, moved)
    assert np.sqrt(((blended - paths) ** 2).sum(axis=-1).mean()) < 0.01
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert (weights >= 0).all() and ((weights > 0).sum(axis=1) <= 4).all()
    assert (weights.argmax(axis=1) == bones.owners).mean() > 0.9


def test_a_joint_moves_as_its_ring_on_average_or_else_with_its_bone(rng):
    rest, joints = rng.normal(size=(8, 3)), rng.normal(size=(2, 3))
    turn = vectors_to_matrices(rng.normal(size=(3, 2, 3)))
    shift = rng.normal(size=(3, 2, 3))
    weights = np.tile([0.25, 0.75], (8, 1))
    rings = np.array([[True] * 8, [False] * 8])
    found = joint_paths(rest, weights, turn, shift, rings, joints)
    moved = np.einsum("fbac,vc->fbva", turn, rest) + shift[:, :, None]
    blended = 0.25 * moved[:, 0] + 0.75 * moved[:, 1]
    np.testing.assert_allclose(found[:, 0], joints[0] + (blended - rest).mean(axis=1))
    np.testing.assert_allclose(found[:, 1], turn[:, 1] @ joints[1] + shift[:, 1])


def test_weights_stay_on_the_simplex(rng):
    found = project_on_simplex(rng.normal(size=(50, 4)))
    np.testing.assert_allclose(found.sum(axis=1), 1.0)
    assert (found >= 0).all()
    inside = rng.dirichlet(np.ones(4), size=20)
    np.testing.assert_allclose(project_on_simplex(inside), inside, atol=1e-12)


def test_bones_two_steps_apart_are_neighbours():
    near = neighbourhood(np.array([-1, 0, 1, 2]))
    assert near[0].tolist() == [True, True, True, False]

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.evaluate import metrics, weights
from bunraku.graphs import mesh_edges
from bunraku.rotations import compose_transforms, invert_rigid
from bunraku.routes.from_rig import RigTransfer
from bunraku.skinning import linear_blend_skinning
from bunraku.types import Character, FormatError, Skin


def write_body(path, rng, **more):
    """Write a made-up body of two joints, as the evaluation data stores it."""
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], np.int32)
    shared = {"V": rng.normal(size=(4, 3)), "F": faces, "W": rng.dirichlet([1, 1], size=4)}
    np.savez(path, **shared, J=np.array([[0, 0, 1.0], [0.5, 0, 2.0]]), **more)


@pytest.fixture
def folder(tmp_path, rng):
    write_body(tmp_path / "src.npz", rng, par=np.array([-1, 0]), lab=np.array(["Hips", "Head"]))
    more = {"rest": rng.normal(size=(4, 3)), "src": rng.normal(size=(4, 3))}
    write_body(tmp_path / "tgt01.npz", rng, th=np.array([[0, 0, 0.5], [0.1, 0, 0]]), **more)
    return tmp_path


def test_bodies_stand_upright_and_look_along_z(folder):
    """Z up and front -Y in the file become Y up and front +Z."""
    source = weights.read_source(folder)
    np.testing.assert_allclose(source.skeleton.rest[1, :3, 3], [0.5, 1.0, 0.0])
    (target,) = weights.read_targets(folder, source.skeleton)
    np.testing.assert_allclose(target.joints[1], [0.5, 2.0, 0.0])
    heading = Rotation.from_rotvec([0, 0.5, 0])
    np.testing.assert_allclose(target.turns[0], heading.as_matrix())
    nod = heading * Rotation.from_rotvec([0.1, 0, 0])
    np.testing.assert_allclose(target.turns[1], nod.as_matrix())


def test_left_and_right_are_paired_by_name():
    names = ("Hips", "LeftArm", "RightArm", "LeftEar", "RightLeg")
    np.testing.assert_array_equal(weights.left_right_pairs(names), [[1, 2]])


def test_bone_axes_point_to_children_and_on_from_the_end():
    joints = np.array([[0, 0, 0], [0, 2, 0], [1, 2, 0], [-1, 2, 0.0]])
    axes = weights.bone_axes(joints, np.array([-1, 0, 1, 1]))
    np.testing.assert_allclose(axes[[0, 2, 3]], [[0, 1, 0], [1, 0, 0], [-1, 0, 0]])


def test_a_folder_without_bodies_is_named(tmp_path, folder):
    with pytest.raises(FormatError, match=r"src\.npz: is no body of the weight table"):
        weights.read_source(tmp_path / "nowhere")
    source = weights.read_source(folder)
    (folder / "tgt01.npz").unlink()
    with pytest.raises(FormatError, match="holds no targets"):
        next(weights.read_targets(folder, source.skeleton))


def test_the_heading_of_a_rest_pose_is_no_twist(folder, rng):
    """A figure found at rest, whose rest pose was found facing left."""
    source = weights.read_source(folder)
    (target,) = weights.read_targets(folder, source.skeleton)
    still = replace(target, rest=target.mesh.vertices, turns=np.tile(np.eye(3), (2, 1, 1)))
    left = compose_transforms(np.zeros(3), Rotation.from_rotvec([0, 1.5, 0]).as_matrix())
    ours = object.__new__(RigTransfer)
    ours.__dict__.update(
        repose_motion=np.tile(left, (2, 1, 1)),
        character=Character(
            still.mesh, source.skeleton, Skin(target.weights, np.tile(left, (2, 1, 1)))
        ),
    )
    rested, turns = weights.unpose(ours, still)
    assert metrics.rest_pose_error(rested, still.rest, 1.0) < 1e-9
    np.testing.assert_allclose(turns, still.turns, atol=1e-9)


def make_row(name, errors):
    return weights.Row(name, {"p2p": errors, "ours": [0.0, 0.1]}, {"p2p": True, "ours": False})


def test_tables_show_the_mean_the_worst_and_the_paper():
    means, worst, own = weights.tabulate([make_row("t1", [1.0, 3.0]), make_row("t2", [2.0, 6.0])])
    cells = [[next(iter(column.cells)) for column in table.columns] for table in (means, worst)]
    assert cells[0] == ["p2p", "2", "4", "3", "4", "2", "3.63"]
    assert cells[1] == ["p2p", "3", "6", "4.5", "12.6"]
    assert len(own.columns) == 5


def test_the_stored_truth_is_exact(data):
    """Undoing the stored turns about the stored joints must give the stored rest pose."""
    source = weights.read_source(data / "weights")
    target = next(iter(weights.read_targets(data / "weights", source.skeleton)))
    with np.load(data / "weights" / "tgt01.npz") as stored:
        rest_joints = stored["Jrest"] @ weights.OURS_FROM_FILE.T
    posed = compose_transforms(target.joints, target.turns)
    identity = np.broadcast_to(np.eye(3), target.turns.shape)
    motion = compose_transforms(rest_joints, identity) @ invert_rigid(posed)
    forwards = linear_blend_skinning(target.rest, target.weights, np.linalg.inv(motion))
    assert (
        metrics.pose_distance(forwards, target.mesh.vertices, 1.0) < 0.01
    )  # a tenth of a millimetre
    assert len(mesh_edges(target.mesh.faces)) == 3 * len(target.mesh.vertices) - 6

"""three-vrm finds the bones of a human in what we write, and moves the skin with them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from bunraku import builtin
from bunraku.formats import read_figure, write_character, write_mesh
from bunraku.formats.gltf.humanoid import REQUIRED
from bunraku.humanoids import name_joints
from bunraku.types import Character, Figure, Skin


def dress(figure: Figure) -> Character:
    """Bind a figure to the built-in human's joints, each vertex to the nearest of the human's."""
    human = builtin.human()
    size = np.ptp(figure.mesh.vertices[:, 1]) / np.ptp(human.mesh.vertices[:, 1])
    nearest = KDTree(size * human.mesh.vertices).query(figure.mesh.vertices)[1]
    rest = human.skeleton.rest.copy()
    rest[:, :3, 3] *= size
    bind = np.linalg.inv(human.skin.inverse_bind)
    bind[:, :3, 3] *= size
    skin = Skin(human.skin.weights[nearest], np.linalg.inv(bind))
    return Character(figure.mesh, replace(human.skeleton, rest=rest), skin)


def test_a_figure_becomes_a_vrm(load_vrm, validate, tmp_path):
    human = builtin.human()
    write_mesh(tmp_path / "plain.ply", human.mesh)
    figure, out = read_figure(tmp_path / "plain.ply"), tmp_path / "made.vrm"
    write_character(out, figure, dress(figure), bones=name_joints(human.skeleton))
    (found,) = load_vrm([out])
    assert found["version"] == "1"
    assert set(REQUIRED) <= set(found["bones"])
    assert all(bone == node for bone, node in found["bones"].items())
    assert 0.02 < found["moved"] / found["numbers"] < 0.3  # the left arm's
    assert not validate([out])[0]["errors"]


@pytest.mark.parametrize("name", ["stylised/vrm/cryptovoxels.vrm"])
def test_a_vrm_of_another_rig_gets_new_bones(load_vrm, data, tmp_path, name):
    """The bones went on pointing at the old joints, which move nothing."""
    figure, out = read_figure(data / name), tmp_path / "again.vrm"
    human = builtin.human()
    write_character(out, figure, dress(figure), bones=name_joints(human.skeleton))
    before, after = load_vrm([data / name, out])
    assert before["version"] == after["version"] == "0"
    assert set(after["bones"].values()) <= set(human.skeleton.names)
    assert 0.01 < after["moved"] / after["numbers"] < 0.4

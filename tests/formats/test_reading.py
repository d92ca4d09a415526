import os

import numpy as np
import pytest

from bunraku.formats import read_character, read_figure, read_motion, write_character, write_mesh
from bunraku.types import Character, Clip, FormatError, Mesh, Skeleton, Skin

BVH = b"HIERARCHY\nROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
BVH += b"End Site\n{\nOFFSET 0 100 0\n}\n}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"


def write(folder, name, content):
    (folder / name).write_bytes(content)
    return folder / name


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.glb"])
def test_a_mesh_comes_back_from_every_format(cube, tmp_path, name):
    write_mesh(tmp_path / name, cube)
    figure = read_figure(tmp_path / name, up="y")
    np.testing.assert_allclose(figure.mesh.vertices, cube.vertices)
    np.testing.assert_array_equal(figure.mesh.faces, cube.faces)
    assert figure.path == str(tmp_path / name)
    assert not figure.pieces.any()


def test_the_name_of_a_file_does_not_matter(cube, tmp_path):
    write_mesh(tmp_path / "a.ply", cube)
    os.rename(tmp_path / "a.ply", tmp_path / "a.glb")
    assert len(read_figure(tmp_path / "a.glb").mesh.faces) == 12


def test_pieces_of_an_obj_are_numbered(tmp_path):
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng a\nf 1 2 3\ng b\nf 2 3 4\n"
    figure = read_figure(write(tmp_path, "a.obj", text))
    assert figure.pieces.tolist() == [0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize("name", ["a.obj", "a.glb"])
def test_given_axes_turn_the_figure(cube, tmp_path, name):
    write_mesh(tmp_path / name, cube)
    turned = read_figure(tmp_path / name, up="z").mesh.vertices
    np.testing.assert_allclose(turned, cube.vertices[:, [0, 2, 1]] * [1, 1, -1], atol=1e-12)
    aside = read_figure(tmp_path / name, up="y", facing="+x").mesh.vertices
    np.testing.assert_allclose(aside, cube.vertices[:, [2, 1, 0]] * [-1, 1, 1], atol=1e-12)
    upward = read_figure(tmp_path / name, facing="-y").mesh.vertices  # so z must be up
    np.testing.assert_allclose(upward, turned, atol=1e-12)


def rigged(mesh):
    skeleton = Skeleton(("root", "tip"), np.array([-1, 0]), np.tile(np.eye(4), (2, 1, 1)))
    weights = np.zeros((len(mesh.vertices), 2))
    weights[np.arange(len(weights)), (mesh.vertices[:, 1] > 0.5).astype(int)] = 1.0
    rotations = np.tile([0.0, 0, 0, 1], (2, 2, 1))
    rotations[1, 1] = [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    zeros, ones = np.zeros((2, 2, 3)), np.ones((2, 2, 3))
    clip = Clip("nod", np.array([0.0, 1.0]), zeros, rotations, ones)
    return Character(mesh, skeleton, Skin(weights, np.tile(np.eye(4), (2, 1, 1))), (clip,))


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.glb"])
def test_a_figure_of_any_format_comes_back_rigged(cube, tmp_path, name):
    write_mesh(tmp_path / name, cube)
    figure = read_figure(tmp_path / name, up="y")
    write_character(tmp_path / "out.glb", figure, rigged(figure.mesh))
    back = read_character(tmp_path / "out.glb")
    np.testing.assert_allclose(back.mesh.vertices, cube.vertices, atol=1e-6)
    assert [clip.name for clip in back.clips] == ["nod"]
    assert {"root", "tip"} <= set(back.skeleton.names)


@pytest.mark.parametrize("name", ["a.obj", "a.glb"])
def test_a_figure_knows_how_it_was_turned(cube, tmp_path, name):
    write_mesh(tmp_path / name, cube)
    figure = read_figure(tmp_path / name, up="z", facing="+x")
    turn = figure.world_from_file[:3, :3]
    np.testing.assert_allclose(figure.mesh.vertices, cube.vertices @ turn.T, atol=1e-6)
    np.testing.assert_array_equal(turn @ [1, 0, 0], [0, 0, 1])


@pytest.mark.parametrize(
    ("read", "content", "message"),
    [
        (read_figure, BVH, "is a BVH motion, not a figure"),
        (read_character, b"v 0 0 0\nv 1 0 0\n", "is OBJ, which holds no rig"),
        (read_motion, b"v 0 0 0\nv 1 0 0\n", "is OBJ, not a BVH motion"),
        (read_figure, b"<html>", "holds a web page"),
    ],
)
def test_the_wrong_kind_of_file_is_named(tmp_path, read, content, message):
    with pytest.raises(FormatError, match=message):
        read(write(tmp_path, "a.bin", content))


def test_outputs_of_no_known_suffix_are_refused(cube, tmp_path):
    with pytest.raises(FormatError, match=r"written as \.stl; wanted \.obj \.ply or \.glb"):
        write_mesh(tmp_path / "a.stl", cube)
    write_mesh(tmp_path / "a.glb", cube)
    figure = read_figure(tmp_path / "a.glb")
    with pytest.raises(FormatError, match=r"cannot hold a rig as \.obj; wanted \.glb"):
        write_character(tmp_path / "out.obj", figure, rigged(figure.mesh))
    assert os.listdir(tmp_path) == ["a.glb"]


def test_a_point_cloud_is_a_figure(tmp_path, rng, caplog):
    cloud = Mesh(rng.normal(size=(150, 3)).astype(np.float32).astype(float), np.empty((0, 3), int))
    write_mesh(tmp_path / "a.ply", cloud)
    figure = read_figure(tmp_path / "a.ply", up="y")
    np.testing.assert_array_equal(figure.mesh.vertices, cloud.vertices)
    assert figure.mesh.faces.shape == (0, 3)

import numpy as np
import pytest

from bunraku.formats import write_mesh
from bunraku.types import FormatError, Mesh


@pytest.mark.parametrize("name", ["a.obj", "a.PLY", "a.glb"])
def test_the_same_mesh_gives_the_same_bytes(cube, tmp_path, name):
    write_mesh(tmp_path / name, cube)
    first = (tmp_path / name).read_bytes()
    write_mesh(tmp_path / name, Mesh(cube.vertices.copy(), cube.faces.copy()))
    assert (tmp_path / name).read_bytes() == first


def test_an_obj_is_plain_text(tmp_path):
    mesh = Mesh(np.array([[0.0, 0, 0], [0.5, 0, 0], [0, 1e-7, 0]]), np.array([[0, 1, 2]]))
    write_mesh(tmp_path / "a.obj", mesh)
    lines = (tmp_path / "a.obj").read_text().splitlines()
    assert lines[1:] == ["v 0 0 0", "v 0.5 0 0", "v 0 1e-07 0", "f 1 2 3"]


def test_a_folder_that_is_not_there_is_named(cube, tmp_path):
    with pytest.raises(FormatError, match=r"a\.obj: cannot be written: its folder does not exist"):
        write_mesh(tmp_path / "none" / "a.obj", cube)

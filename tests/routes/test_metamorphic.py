"""The skin of a figure does not hang on how its mesh is written down."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from bunraku.formats import read_figure
from bunraku.routes.from_rig import animate_from_rig
from bunraku.types import Mesh
from tests.creatures import make_creature
from tests.formats.test_metamorphic import write

SAME = 1e-5


def shuffle(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """Permute vertices, faces and the corners of faces; give also each new vertex's old one."""
    rng = np.random.default_rng(0)
    order = rng.permutation(len(mesh.vertices))
    faces = np.roll(np.argsort(order)[mesh.faces], 1, axis=1)
    return Mesh(mesh.vertices[order], faces[rng.permutation(len(faces))]), order


def unweld(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """Give every corner a vertex of its own."""
    corners = mesh.faces.reshape(-1)
    return Mesh(mesh.vertices[corners], np.arange(len(corners)).reshape(-1, 3)), corners


def scale(factor: float):
    def change(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
        return Mesh(mesh.vertices * factor, mesh.faces), np.arange(len(mesh.vertices))

    return change


def move(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """Put a mesh ten thousand of its heights away."""
    return Mesh(mesh.vertices + np.array([1e4, -1e4, 0.5e4]), mesh.faces), np.arange(
        len(mesh.vertices)
    )


def turn(degrees: float):
    """Turn a mesh about the vertical."""

    def change(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
        about = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
        return Mesh(mesh.vertices @ about.T, mesh.faces), np.arange(len(mesh.vertices))

    return change


@pytest.fixture(scope="module")
def figure() -> Mesh:
    return make_creature(0.028).mesh


@pytest.fixture(scope="module")
def skin(creature, figure) -> np.ndarray:
    return animate_from_rig(creature, figure, clips=()).character.skin.weights


@pytest.mark.parametrize(
    "change",
    [shuffle, unweld, scale(1e-6), scale(1e7), move, turn(90), turn(37)],
    ids=[
        "order",
        "unwelded",
        "scale 1e-6",
        "scale 1e7",
        "moved 1e4",
        "turned 90",
        "turned 37",
    ],
)
def test_the_skin_stays_the_same(creature, figure, skin, change):
    changed, old_of = change(figure)
    weights = animate_from_rig(creature, changed, clips=()).character.skin.weights
    np.testing.assert_allclose(weights, skin[old_of], atol=SAME)


def test_the_skin_does_not_hang_on_which_axis_of_the_file_is_up(creature, figure, skin, tmp_path):
    lying = Mesh(figure.vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0], figure.faces)
    path = write(tmp_path, lying, "off")
    found = read_figure(path, up="z", facing="-y").mesh
    np.testing.assert_allclose(found.vertices, figure.vertices, atol=1e-12)
    weights = animate_from_rig(creature, found, clips=()).character.skin.weights
    np.testing.assert_allclose(weights, skin, atol=SAME)


@pytest.fixture(scope="module")
def rounded(figure) -> Mesh:
    """The figure with coordinates that every format holds exactly."""
    return Mesh(figure.vertices.astype(np.float32).astype(float), figure.faces)


@pytest.fixture(scope="module")
def rounded_skin(creature, rounded) -> np.ndarray:
    return animate_from_rig(creature, rounded, clips=()).character.skin.weights


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "off", "glb"])
def test_the_skin_does_not_hang_on_the_format(creature, rounded, rounded_skin, tmp_path, kind):
    found = read_figure(write(tmp_path, rounded, kind), up="y", facing="+z").mesh
    distance, old_of = cKDTree(rounded.vertices).query(found.vertices)
    assert distance.max() == 0
    weights = animate_from_rig(creature, found, clips=()).character.skin.weights
    np.testing.assert_allclose(weights, rounded_skin[old_of], atol=SAME)

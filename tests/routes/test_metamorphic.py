"""The skin of a figure does not hang on how its mesh is written down."""

import numpy as np
import pytest

from bunraku.routes.from_rig import animate_from_rig
from bunraku.types import Mesh
from tests.creatures import make_creature

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


@pytest.fixture(scope="module")
def figure() -> Mesh:
    return make_creature(0.028).mesh


@pytest.fixture(scope="module")
def skin(creature, figure) -> np.ndarray:
    return animate_from_rig(creature, figure, clips=()).character.skin.weights


@pytest.mark.parametrize(
    "change",
    [shuffle, unweld, scale(1e-6), scale(1e7)],
    ids=["order", "unwelded", "scale 1e-6", "scale 1e7"],
)
def test_the_skin_stays_the_same(creature, figure, skin, change):
    changed, old_of = change(figure)
    weights = animate_from_rig(creature, changed, clips=()).character.skin.weights
    np.testing.assert_allclose(weights, skin[old_of], atol=SAME)

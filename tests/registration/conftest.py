import pytest

from bunraku.meshes import scale_to_unit_area
from bunraku.registration.puppet import Pose, Puppet, make_puppet
from bunraku.rotations import vectors_to_matrices
from bunraku.skinning import forward_kinematics
from bunraku.types import Character
from tests.creatures import NAMES


def puppet_of(character: Character) -> Puppet:
    """Make a character its own proxy: at area 1, centred."""
    unit, centre, scale = scale_to_unit_area(character.mesh.vertices, character.mesh.faces)
    joints = forward_kinematics(character.skeleton.parents, character.skeleton.rest)[:, :3, 3]
    return make_puppet(
        *(unit, character.mesh.faces, character.skin.weights),
        (joints - centre) / scale,
        character.skeleton.parents,
    )


@pytest.fixture(scope="session")
def puppet(creature) -> Puppet:
    return puppet_of(creature)


@pytest.fixture
def somehow(puppet, rng) -> Pose:
    """A random pose: every joint turned and scaled."""
    turns = vectors_to_matrices(rng.normal(scale=0.5, size=(len(NAMES), 3)))
    return Pose(rng.normal(size=3), turns, rng.normal(scale=0.2, size=(len(NAMES), 2)))

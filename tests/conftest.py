import os
from pathlib import Path

import jaxtyping
import numpy as np
import pytest

from bunraku.evaluate.rendering import Film, film_character
from bunraku.registration.body import Body, wrap_character
from bunraku.routes.from_depth import Capture, capture_performer
from bunraku.skinning import forward_kinematics
from bunraku.types import Character, Mesh, Skeleton, Skin
from tests.creatures import make_creature

SHARED_DATA = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def as_user():
    """Switch off the shape checks that only tests run, to see the errors a user sees."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of evaluation characters, or a skip that says how to get past it."""
    folder = Path(os.environ.get("BUNRAKU_DATA", SHARED_DATA))
    if not folder.is_dir():
        pytest.skip("no evaluation data: set BUNRAKU_DATA to its folder")
    return folder


@pytest.fixture
def arm() -> Skeleton:
    """Shoulder at the origin, elbow and wrist one metre apart along +X."""
    rest = np.tile(np.eye(4), (3, 1, 1))
    rest[1:, 0, 3] = 1.0
    return Skeleton(("shoulder", "elbow", "wrist"), np.array([-1, 0, 1]), rest)


@pytest.fixture
def arm_skin(arm: Skeleton, rng: np.random.Generator) -> Skin:
    """Random weights for seven vertices, bound in the rest pose."""
    rest_world = forward_kinematics(arm.parents, arm.rest)
    return Skin(rng.dirichlet(np.ones(3), size=7), np.linalg.inv(rest_world))


@pytest.fixture
def cube() -> Mesh:
    """Twelve triangles around the unit cube, facing outwards."""
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Mesh(corners, np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))]))


@pytest.fixture(scope="session")
def creature() -> Character:
    """The smallest whole character: 1.1 m high, 3,300 vertices, seven joints, one clip "Wave"."""
    return make_creature()


@pytest.fixture(scope="session")
def body(creature: Character) -> Body:
    """The creature wrapped in its proxy."""
    return wrap_character(creature)


@pytest.fixture(scope="session")
def film(creature: Character) -> Film:
    """The creature's wave, filmed from three quarters: 18 noisy frames with their truth."""
    return film_character(creature, creature.clips[0], turn=40.0, most_frames=18)


@pytest.fixture(scope="session")
def capture(film: Film) -> Capture:
    """The creature as captured from that film."""
    return capture_performer(film.video)

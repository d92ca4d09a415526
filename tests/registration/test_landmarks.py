import numpy as np
import pytest

from bunraku.meshes import scale_to_unit_area
from bunraku.registration.articulated import COARSE, fit
from bunraku.registration.correspondence import make_surface
from bunraku.registration.landmarks import HELD, hold_landmarks
from bunraku.registration.puppet import move_puppet, rest_pose
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Mesh
from tests.creatures import JOINTS, NAMES


def stand(points: np.ndarray) -> np.ndarray:
    return 2.0 * points + [1.0, 0.0, -3.0]


def clicked(*names: str) -> dict[str, list[float]]:
    """Give joints of the figure as a person would."""
    return {name: stand(JOINTS[NAMES.index(name)]).tolist() for name in names}


@pytest.fixture(scope="module")
def figure(body) -> Mesh:
    """The creature's proxy, twice as large and elsewhere."""
    return Mesh(stand(body.proxy.mesh.vertices), body.proxy.mesh.faces)


@pytest.fixture(scope="module")
def surface(figure):
    return make_surface(scale_to_unit_area(figure.vertices, figure.faces)[0], figure.faces)


def test_landmarks_are_points_beside_the_surface_that_pins_hold(body, figure, surface):
    held, goal = hold_landmarks(body, figure, surface, clicked("head", "leftArm"), NAMES)
    count, others = len(body.puppet.vertices), len(surface.vertices)
    assert len(held.puppet.vertices) == count + 2 and len(goal.vertices) == others + 2
    assert held.puppet.faces.max() < count and goal.faces.max() < others
    np.testing.assert_array_equal(goal.pins.moving, [count, count + 1])
    np.testing.assert_array_equal(goal.pins.still, [others, others + 1])
    np.testing.assert_array_equal(goal.pins.weight, HELD)
    # at area 1 the larger figure's head is where the source's is, and so is its landmark
    np.testing.assert_allclose(goal.vertices[others], held.puppet.vertices[count], atol=1e-9)
    arm = body.puppet.joints.tolist().index(NAMES.index("leftArm"))
    np.testing.assert_array_equal(held.puppet.weights[count + 1], np.eye(7)[arm])
    np.testing.assert_allclose(held.puppet.vertices[count + 1], body.puppet.anchors[arm])


def test_without_landmarks_all_stays_as_it_is(body, figure, surface):
    held, goal = hold_landmarks(body, figure, surface, {}, NAMES)
    np.testing.assert_array_equal(held.puppet.vertices, body.puppet.vertices)
    np.testing.assert_array_equal(goal.vertices, surface.vertices)
    assert len(goal.pins.moving) == 0


def test_a_landmark_of_no_joint_is_refused(body, figure, surface):
    with pytest.raises(ValueError, match="landmark 'tail' is no joint of the performance; it has"):
        hold_landmarks(body, figure, surface, {"tail": [0.0, 0.0, 0.0]}, NAMES)


def test_landmarks_bring_home_a_fit_that_would_be_lost(body, figure, surface):
    """Started 60 degrees off, closest points alone take arms for other things."""
    names = ("leftArm", "rightArm", "leftLeg", "rightLeg", "head")
    held, goal = hold_landmarks(body, figure, surface, clicked(*names), NAMES)
    start = rest_pose(body.puppet, vectors_to_matrices(np.array([0.0, np.deg2rad(60), 0.0])))
    helped, alone = (
        move_puppet(body.puppet, fit(puppet, start, to, COARSE))[0]
        for puppet, to in ((held.puppet, goal), (body.puppet, surface))
    )
    near, far = (
        np.linalg.norm(fitted - surface.vertices, axis=1).mean() for fitted in (helped, alone)
    )
    assert near < 0.01 and far > 3 * near  # measured .0006 and .036

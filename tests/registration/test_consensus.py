import numpy as np
import pytest

from bunraku.registration import consensus
from bunraku.registration.consensus import price, register_with_landmarks, trials
from bunraku.registration.puppet import rest_pose
from bunraku.registration.search import Registration, register_body
from bunraku.types import Mesh
from tests.creatures import JOINTS, NAMES

RIGHT = {name: JOINTS[NAMES.index(name)].tolist() for name in ("head", "leftArm", "rightArm")}


@pytest.fixture(scope="module")
def figure(body) -> Mesh:
    return body.proxy.mesh


def off(found: Registration) -> float:
    """Give the largest distance of joints from the truth, in heights of 1.1 m."""
    return float(np.linalg.norm(found.joints - JOINTS, axis=1).max() / 1.1)


def test_right_landmarks_are_believed(body, figure):
    found, warnings = register_with_landmarks(body, figure, RIGHT, NAMES)
    assert warnings == () and off(found) < 0.02


def test_without_landmarks_nothing_is_asked(body, figure):
    found, warnings = register_with_landmarks(body, figure, None, NAMES)
    assert warnings == ()
    np.testing.assert_array_equal(found.fitted, register_body(body, figure).fitted)


def test_one_wrong_landmark_is_left_out_by_name(body, figure):
    wrong = RIGHT | {"leftArm": (JOINTS[3] + [0.0, 0.33, 0.0]).tolist()}
    found, (warning,) = register_with_landmarks(body, figure, wrong, NAMES)
    assert off(found) < 0.02
    assert "landmark 'leftArm' was left out: it lies 0.3" in warning


def test_a_pair_with_swapped_sides_is_left_out(body, figure):
    swapped = RIGHT | {"leftArm": RIGHT["rightArm"], "rightArm": RIGHT["leftArm"]}
    found, warnings = register_with_landmarks(body, figure, swapped, NAMES)
    assert off(found) < 0.02
    assert [warning.split("'")[1] for warning in warnings] == ["leftArm", "rightArm"]


def test_a_landmark_of_no_joint_is_refused(body, figure):
    with pytest.raises(ValueError, match="landmark 'tail' is no joint"):
        register_with_landmarks(body, figure, {"tail": [0.0, 0.0, 0.0]}, NAMES)


def fit_of(body, error: float) -> Registration:
    """Give a fit that turned nothing: its strain is its misfit."""
    return Registration(rest_pose(body.puppet), body.proxy.mesh.vertices, JOINTS, error, ())


@pytest.mark.parametrize(("strain", "left_out"), [(0.2, 2), (0.4, 0)])
def test_a_person_is_believed_where_the_fit_is_poor(monkeypatch, body, figure, strain, left_out):
    """Leaving both out lowers the strain by a fifth: enough for a good fit, not for a poor one."""
    apart = {"leftArm": [9.0, 0.0, 0.0], "rightArm": [-9.0, 0.0, 0.0]}

    def fit(*_, landmarks=None, names=()):
        return fit_of(body, strain if landmarks else 0.8 * strain)

    monkeypatch.setattr(consensus, "register_body", fit)
    assert len(register_with_landmarks(body, figure, apart, NAMES)[1]) == left_out


def test_trials_begin_with_all_doubtful_ones_and_then_the_worst():
    away = {"a": 0.1, "b": 0.9, "c": 0.5}
    assert list(trials(["a", "b", "c"], away)) == [
        frozenset("abc"),
        frozenset("b"),
        frozenset("c"),
        frozenset("a"),
    ]
    assert list(trials(["a"], away)) == [frozenset("a")] and not list(trials([], away))
    many = [str(i) for i in range(20)]
    assert len(list(trials(many, dict.fromkeys(many, 1.0)))) == 7


def test_the_price_by_hand(body):
    assert price(fit_of(body, 0.2), 2) == pytest.approx(0.2 * 1.1025)
    assert price(fit_of(body, 0.4), 1) == pytest.approx(0.46)

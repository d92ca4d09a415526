from dataclasses import replace

import numpy as np
import pytest

from bunraku.reposing.symmetry import straighten, symmetry_axis, twin_bones
from tests.creatures import JOINTS, NAMES


def test_a_symmetric_figure_stays_as_it_is(body):
    np.testing.assert_allclose(straighten(2 * JOINTS, body, 1.0), 2 * JOINTS, atol=1e-12)


def test_what_differs_from_left_to_right_is_shared_out(body):
    crooked = JOINTS.copy()
    crooked[NAMES.index("leftLeg")] += [0.02, 0.06, 0.04]
    crooked[NAMES.index("head"), 0] += 0.1
    straight = straighten(crooked, body, 1.0)
    np.testing.assert_allclose(straight[NAMES.index("head")], JOINTS[NAMES.index("head")])
    left, right = straight[[NAMES.index("leftLeg"), NAMES.index("rightLeg")]]
    np.testing.assert_allclose(left, right * [-1, 1, 1], atol=1e-12)
    middle = JOINTS[NAMES.index("leftLeg")] + [0.01, 0.03, 0.02]
    np.testing.assert_allclose(left, middle, atol=1e-12)


def test_the_hips_stay_and_a_share_does_a_share(body):
    crooked = JOINTS + np.array([0.3, 0.1, 0.2])
    crooked[NAMES.index("chest"), 0] += 0.08
    hips, chest = NAMES.index("hips"), NAMES.index("chest")
    half = straighten(crooked, body, 0.5)
    np.testing.assert_allclose(half[hips], crooked[hips])
    assert half[chest, 0] - half[hips, 0] == pytest.approx(0.04)
    assert straighten(crooked, body, 0.0) is crooked


def test_bones_that_the_source_does_not_mirror_stay(body):
    """A source with one arm up says nothing of a figure's arms."""
    joints = JOINTS.copy()
    joints[NAMES.index("leftArm")] = [0.05, 0.95, 0.1]
    lopsided = replace(body, joints=joints)
    _, symmetric = twin_bones(lopsided, 0)
    assert not symmetric[[NAMES.index("leftArm"), NAMES.index("rightArm")]].any()
    assert symmetric[[NAMES.index("leftLeg"), NAMES.index("rightLeg")]].all()
    figure = JOINTS.copy()
    figure[NAMES.index("rightArm")] += 0.03
    np.testing.assert_allclose(straighten(figure, lopsided, 1.0), figure)


def test_a_source_that_looks_along_x_is_mirrored_across_z(body):
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    vertices = body.proxy.mesh.vertices @ quarter.T
    assert symmetry_axis(JOINTS @ quarter.T, vertices) == 2
    mesh = replace(body.proxy.mesh, vertices=vertices)
    aside = replace(body, joints=JOINTS @ quarter.T, proxy=replace(body.proxy, mesh=mesh))
    crooked = JOINTS.copy()
    crooked[NAMES.index("leftLeg"), 1] += 0.06
    expected = straighten(crooked, body, 1.0) @ quarter.T
    np.testing.assert_allclose(straighten(crooked @ quarter.T, aside, 1.0), expected, atol=1e-12)

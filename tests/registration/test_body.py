from dataclasses import replace

import numpy as np
import pytest

from bunraku.meshes import is_closed, surface_area
from bunraku.registration.body import wrap_character
from bunraku.types import Character, Mesh, Skin
from tests.creatures import JOINTS, PARENTS, true_weights


def test_the_proxy_carries_the_characters_own_skin(body):
    vertices, areas, weights = body.surface
    assert is_closed(body.proxy.mesh.faces)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    assert np.abs(weights - true_weights(vertices)).mean() < 0.01  # measured .001
    assert np.isclose(areas.sum(), surface_area(vertices, body.proxy.mesh.faces))


def test_joints_stay_in_metres_and_their_puppet_has_area_one(body):
    np.testing.assert_allclose(body.joints, JOINTS, atol=1e-9)
    np.testing.assert_array_equal(body.parents, PARENTS)
    np.testing.assert_array_equal(body.carriers, PARENTS)
    assert np.isclose(body.puppet.areas.sum(), 1)
    scale = np.sqrt(body.areas.sum())
    between = np.linalg.norm(body.puppet.anchors[1:] - body.puppet.anchors[0], axis=1) * scale
    own = np.linalg.norm(JOINTS[body.puppet.joints[1:]] - JOINTS[body.puppet.joints[0]], axis=1)
    np.testing.assert_allclose(between, own, atol=1e-9)


def test_a_character_without_a_surface_is_refused(creature):
    bare = replace(creature, mesh=Mesh(creature.mesh.vertices, np.zeros((0, 3), np.int64)))
    with pytest.raises(ValueError, match="has a skeleton but no surface"):
        wrap_character(bare)


def test_stray_and_doubled_vertices_and_flat_faces_change_little(creature, body):
    mesh, skin = creature.mesh, creature.skin
    vertices = np.vstack([mesh.vertices, mesh.vertices[:50], [[0.2, 0.5, 0.4]]])
    faces = np.vstack([mesh.faces, [[0, 0, 1], [7, 7, 7]], mesh.faces[:20]])
    weights = np.vstack([skin.weights, skin.weights[:50], np.eye(7)[:1]])
    untidy = Character(Mesh(vertices, faces), creature.skeleton, Skin(weights, skin.inverse_bind))
    wrapped = wrap_character(untidy)
    assert np.isclose(wrapped.areas.sum(), body.areas.sum(), rtol=0.02)
    np.testing.assert_array_equal(wrapped.puppet.parents, body.puppet.parents)

import numpy as np

from bunraku.builtin import human, human_parts
from bunraku.meshes import connected_parts, is_closed, signed_volume


def test_human_is_one_closed_part_that_stands_on_the_ground():
    mesh = human().mesh
    assert is_closed(mesh.faces)
    assert connected_parts(mesh.faces, len(mesh.vertices)).max() == 0
    assert signed_volume(mesh.vertices, mesh.faces) > 0
    assert abs(mesh.vertices[:, 1].min()) < 1e-6
    assert 1.6 < np.ptp(mesh.vertices[:, 1]) < 1.9


def test_every_vertex_has_at_most_four_influences():
    assert (human().skin.weights > 0).sum(axis=1).max() <= 4


def test_every_vertex_has_a_part():
    labels, names = human_parts()
    assert len(labels) == len(human().mesh.vertices)
    assert set(labels) == set(range(len(names)))

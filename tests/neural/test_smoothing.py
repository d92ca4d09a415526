import numpy as np

from bunraku.meshes import weld
from bunraku.neural.smoothing import diffuse, stiffen
from bunraku.types import Mesh


def boxes(cube, *shifts):
    """Loose cubes beside one another, vertices doubled as files have them."""
    corners = np.concatenate([cube.vertices[cube.faces].reshape(-1, 3) + s for s in shifts])
    return Mesh(corners, np.arange(len(corners)).reshape(-1, 3))


def test_a_loose_piece_of_nearly_one_part_is_rigid_and_others_are_left(cube):
    mesh = boxes(cube, [0.0, 0, 0], [5.0, 0, 0])
    weights = np.tile([0.5, 0.5, 0.0], (len(mesh.vertices), 1))
    half = len(mesh.vertices) // 2
    weights[:half] = [0.1, 0.8, 0.1]
    weights[0] = [1.0, 0.0, 0.0]  # one vertex is mistaken
    stiff = stiffen(weights, mesh)
    assert np.array_equal(stiff[:half], np.tile([0.0, 1.0, 0.0], (half, 1)))
    assert np.array_equal(stiff[half:], weights[half:])


def test_a_body_of_one_piece_keeps_its_limbs_however_large_its_chest(cube):
    mesh = boxes(cube, [0.0, 0, 0])
    weights = np.tile([0.1, 0.9], (len(mesh.vertices), 1))
    assert np.array_equal(stiffen(weights, mesh), weights)


def test_a_cloud_is_left_alone():
    weights = np.eye(3)
    assert stiffen(weights, Mesh(np.eye(3), np.zeros((0, 3), np.int64))) is weights


def test_weights_flow_along_the_surface_and_stay_whole(cube):
    mesh = boxes(cube, [0.0, 0, 0])
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(4), len(mesh.vertices))
    smooth = diffuse(weights, mesh, reach=1.0)
    assert np.allclose(smooth.sum(axis=1), 1.0) and smooth.min() >= 0
    place = weld(mesh.vertices, mesh.faces)[2]
    for corner in range(8):
        assert np.ptp(smooth[place == corner], axis=0).max() < 1e-12
    assert np.ptp(smooth, axis=0).max() < np.ptp(weights, axis=0).max()

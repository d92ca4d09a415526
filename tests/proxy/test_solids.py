import igl
import numpy as np
import pytest
from scipy import ndimage

from bunraku import meshes
from bunraku.proxy import solids, surfaces, voxels
from bunraku.proxy.closed import is_clean
from tests.proxy.shapes import genus


@pytest.fixture
def ring() -> np.ndarray:
    """A square ring of 9 x 9 x 3 nodes with a hole of 1 x 1."""
    solid = np.zeros((15, 15, 9), bool)
    solid[3:12, 3:12, 3:6] = True
    solid[7, 7] = False
    return solid


def surface(solid: np.ndarray):
    grid = voxels.Grid(np.zeros(3), 1.0, solid.shape)
    return surfaces.march(np.where(solid, -0.5, 0.5), grid)


def test_a_pinhole_is_plugged_and_a_wide_opening_is_not(ring):
    assert genus(surface(ring)) == 1
    assert genus(surface(solids.plug_tunnels(ring, 1))) == 0
    ring[5:10, 5:10] = False
    assert np.array_equal(solids.plug_tunnels(ring, 1), ring)


def test_a_slot_that_makes_no_handle_stays_open(ring):
    ring[7, 7:] = False
    assert genus(surface(ring)) == 0
    assert np.array_equal(solids.plug_tunnels(ring, 1), ring)


def test_cavities_are_filled():
    solid = np.zeros((9, 9, 9), bool)
    solid[2:7, 2:7, 2:7] = True
    hollow = solid.copy()
    hollow[4, 4, 4] = False
    assert np.array_equal(solids.fill(hollow), solid)


def test_one_rod_ties_a_piece(ring):
    two = np.zeros((40, 20, 20), bool)
    two[3:15, 4:16, 4:16] = True
    two[20:30, 5:15, 5:15] = True
    mesh = surface(solids.bridge(two))
    assert meshes.connected_parts(mesh.faces, len(mesh.vertices)).max() == 0
    assert genus(mesh) == 0


def test_a_far_speck_is_dropped():
    two = np.zeros((40, 20, 20), bool)
    two[3:15, 4:16, 4:16] = True
    alone = two.copy()
    two[30, 5, 5] = True
    assert np.array_equal(solids.bridge(two), alone)


@pytest.mark.parametrize("share", [0.01, 0.05, 0.2, 0.5])
def test_any_nodes_become_one_clean_lump(share, rng):
    marked = np.zeros((28, 28, 28), bool)
    marked[3:-3, 3:-3, 3:-3] = rng.random((22, 22, 22)) < share
    mesh = surface(solids.solid_nodes(marked))
    assert is_clean(mesh)
    assert meshes.signed_volume(mesh.vertices, mesh.faces) > 0


def test_of_two_lumps_that_touch_at_a_corner_the_larger_stays():
    solid = np.zeros((9, 9, 9), bool)
    solid[2:4, 2:4, 2:4] = True
    alone = solid.copy()
    solid[4, 4, 4] = True
    assert np.array_equal(solids.largest_piece(solid), alone)
    assert np.array_equal(solids.largest_piece(alone), alone)


@pytest.mark.parametrize("steps", [1, 2])
def test_dilate_and_erode_agree_with_cubes_of_neighbours(steps, rng):
    mask = rng.random((12, 9, 11)) < 0.1
    cube = np.ones((2 * steps + 1,) * 3)
    assert np.array_equal(voxels.dilate(mask, steps), ndimage.binary_dilation(mask, cube))
    assert np.array_equal(voxels.erode(~mask, steps), ndimage.binary_erosion(~mask, cube))


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7])
def test_marching_cubes_of_any_nodes_is_closed(share, rng):
    solid = np.zeros((16, 16, 16), bool)
    solid[1:-1, 1:-1, 1:-1] = rng.random((14, 14, 14)) < share
    mesh = surface(solid)
    assert meshes.is_closed(mesh.faces)
    assert meshes.signed_volume(mesh.vertices, mesh.faces) > 0


@pytest.mark.parametrize("thickness", [0.02, 0.03, 0.045, 0.06, 1.0])  # in cells: 0.8 to 40
def test_sparse_winding_agrees_with_asking_every_node(cube, thickness):
    vertices = cube.vertices * [1, thickness, 1]
    grid = voxels.grid_around(vertices, 40)
    rng = np.random.default_rng(0)
    face, shares = meshes.sample_surface(vertices, cube.faces, 40_000, rng)
    samples = meshes.interpolate(vertices, cube.faces[face], shares)

    def winding(points):
        return igl.fast_winding_number(vertices, cube.faces, points)

    every = winding(grid.points(np.indices(grid.shape).reshape(3, -1).T)).reshape(grid.shape) > 0.5
    assert np.array_equal(voxels.inside_nodes(winding, samples, grid), every)


def test_a_solid_that_touches_the_border_of_its_grid_is_counted_like_any_other():
    assert solids.characteristic(np.ones((3, 4, 5), bool)) == 1
    ring = np.ones((3, 3, 1), bool)
    ring[1, 1] = False
    assert solids.characteristic(ring) == 0  # one piece, one handle

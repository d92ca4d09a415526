import igl
import numpy as np
import pytest

from bunraku import meshes
from bunraku.formats import read_figure
from bunraku.graphs import geodesic_distances
from bunraku.proxy import build_proxy, building, closed, lift
from bunraku.proxy.building import face_outwards
from bunraku.types import Mesh
from tests.proxy.shapes import box, genus, together, trestle

NO_FACES = np.zeros((0, 3), np.int64)


def proxy_of(mesh: Mesh, count: int = 1000):
    proxy = build_proxy(mesh.vertices, mesh.faces, vertex_count=count)
    assert meshes.is_closed(proxy.mesh.faces)
    assert np.all(igl.is_vertex_manifold(proxy.mesh.faces))
    assert meshes.connected_parts(proxy.mesh.faces, len(proxy.mesh.vertices)).max() == 0
    assert meshes.signed_volume(proxy.mesh.vertices, proxy.mesh.faces) > 0
    return proxy


def test_an_open_cube_is_closed_to_the_volume_of_the_whole(cube):
    proxy = proxy_of(Mesh(cube.vertices, cube.faces[:-2]))
    assert abs(meshes.signed_volume(proxy.mesh.vertices, proxy.mesh.faces) - 1) < 0.1
    assert 800 <= len(proxy.mesh.vertices) <= 1200


def test_legs_that_nearly_touch_stay_apart():
    mesh = proxy_of(trestle(), 3000).mesh
    feet = [
        int(np.linalg.norm(mesh.vertices - foot, axis=1).argmin())
        for foot in ([-0.03, 0, 0], [0.03, 0, 0])
    ]
    assert genus(mesh) == 0
    assert geodesic_distances(mesh.vertices, mesh.faces, np.array(feet[:1]))[0, feet[1]] > 1.4


def test_a_cape_gets_a_thickness():
    cape = Mesh(
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    mesh = proxy_of(together(cape, box((0.3, 0.3, -0.4), (0.7, 0.7, 0.0)))).mesh
    assert genus(mesh) == 0
    assert np.allclose(np.ptp(mesh.vertices, axis=0)[:2], 1, atol=0.1)


def test_a_floating_hand_is_kept_and_a_far_speck_is_not():
    body, hand = box((0, 0, 0), (1, 1, 1)), box((1.2, 0.4, 0.4), (1.4, 0.6, 0.6))
    speck = box((1.8, 0, 0), (1.82, 0.02, 0.02))
    mesh = proxy_of(together(body, hand, speck), 2000).mesh
    assert 1.35 < mesh.vertices[:, 0].max() < 1.5
    assert genus(mesh) == 0


def test_parts_facing_inwards_count_as_solid():
    first, second = box((0, 0, 0), (1, 1, 1)), box((0.5, 0.2, 0.2), (1.6, 0.8, 0.8))
    turned = Mesh(second.vertices, second.faces[:, ::-1])
    mesh = proxy_of(together(first, turned)).mesh
    assert abs(meshes.signed_volume(mesh.vertices, mesh.faces) - (1 + 0.6**3)) < 0.1


def test_face_outwards_turns_single_faces_and_whole_parts(cube):
    mixed = cube.faces.copy()
    mixed[3] = mixed[3, ::-1]
    for faces in (mixed, cube.faces[:, ::-1]):
        assert np.isclose(
            meshes.signed_volume(cube.vertices, face_outwards(cube.vertices, faces)), 1
        )


def test_a_cloud_is_wrapped_like_the_surface_it_was_taken_from(cube, rng):
    face, shares = meshes.sample_surface(cube.vertices, cube.faces, 6000, rng)
    points = meshes.interpolate(cube.vertices, cube.faces[face], shares)
    proxy = proxy_of(Mesh(points, NO_FACES))
    assert abs(meshes.signed_volume(proxy.mesh.vertices, proxy.mesh.faces) - 1) < 0.05
    assert np.linalg.norm(lift(proxy, proxy.mesh.vertices) - points, axis=1).max() < 0.06


def test_ruined_faces_do_no_harm(cube):
    ruined = np.concatenate([cube.faces[:-1], [[0, 0, 1], [2, 2, 2]], cube.faces[:1], [[0, 3, 7]]])
    proxy_of(Mesh(cube.vertices, ruined))


def test_every_vertex_sits_near_itself_and_equal_places_sit_equally():
    figure = trestle()
    doubled = np.vstack([figure.vertices, figure.vertices])
    proxy = build_proxy(doubled, figure.faces, vertex_count=3000)
    np.testing.assert_allclose(proxy.barycentric.sum(axis=1), 1)
    assert np.array_equal(proxy.corners[:24], proxy.corners[24:])
    outside = np.abs(figure.vertices[:, 1] - 0.85) > 0.1  # not the ends inside the beam
    apart = np.linalg.norm(lift(proxy, proxy.mesh.vertices)[:24] - figure.vertices, axis=1)
    assert apart[outside].max() < 0.06


def test_vertices_are_placed_alike_in_one_block_and_in_many(cube, rng, monkeypatch):
    points, order = rng.normal(size=(30, 3)), rng.permutation(30)
    whole = building.place(points, order, cube)
    monkeypatch.setattr(building, "BLOCK", 7)
    parted = building.place(points, order, cube)
    assert np.array_equal(whole.corners, parted.corners)
    assert np.array_equal(whole.barycentric, parted.barycentric)


def test_twice_the_same_input_gives_the_same_bytes():
    figure = trestle()
    first, second = (
        build_proxy(figure.vertices, figure.faces, vertex_count=1000) for _ in range(2)
    )
    assert np.array_equal(first.mesh.vertices, second.mesh.vertices)
    assert np.array_equal(first.barycentric, second.barycentric)


def test_a_spoilt_proxy_is_made_anew_on_a_coarser_grid(monkeypatch, caplog):
    tries, resample = [], closed.resample

    def spoil_twice(body, count):
        tries.append(len(body.vertices))
        return None if len(tries) < 3 else resample(body, count)

    monkeypatch.setattr(closed, "resample", spoil_twice)
    mesh = proxy_of(trestle(), 500).mesh
    assert tries[0] > tries[1] > tries[2] and 250 <= len(mesh.vertices) <= 1250
    assert caplog.text.count("trying a coarser grid") == 2


def test_the_last_resort_is_clean_and_of_about_the_right_size(monkeypatch):
    monkeypatch.setattr(closed, "resample", lambda body, count: None)
    assert 250 <= len(proxy_of(trestle(), 500).mesh.vertices) <= 1250


def test_a_line_is_no_figure():
    line = np.linspace([0.0, 0, 0], [1.0, 0, 0], 10)
    with pytest.raises(
        ValueError, match="its 10 vertices are at 10 different places, or on one line"
    ):
        build_proxy(line, NO_FACES)


def test_a_real_character_in_many_open_parts(data):
    figure = read_figure(data / "stylised/quaternius_modular_women/Witch.glb").mesh
    assert genus(proxy_of(figure, 4000).mesh) == 0

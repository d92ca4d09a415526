import json
import struct
from typing import Any

import numpy as np
import pytest

from bunraku import limits
from bunraku.errors import Code
from bunraku.formats import read_figure
from bunraku.formats.fbx import convert_to_glb, geometry
from bunraku.formats.fbx.geometry import check_bindings, read_binding, read_surface
from bunraku.formats.fbx.records import read_records
from bunraku.formats.fbx.scene import Scene, build_scene
from bunraku.types import FormatError
from tests.formats.made_fbx import Node, encode, properties

SQUARE = np.array([0.0, 0, 0, 1, 0, 0, 1, 2, 1, 0, 2, 0])


def box(*corners: int, points: np.ndarray = SQUARE, **model: Any) -> list[Node]:
    """Make a node that shows polygons of some points."""
    objects, links = Node("Objects"), Node("Connections")
    properties(objects.add("Model", 1, "box\0\x01Model", "Mesh"), **model)
    geometry = objects.add("Geometry", 2, "box\0\x01Geometry", "Mesh")
    geometry.add("Vertices", points)
    geometry.add("PolygonVertexIndex", np.array(corners or (0, 1, 2, -4), "<i4"))
    links.add("C", "OO", 1, 0)
    links.add("C", "OO", 2, 1)
    return [objects, links]


def bind(records: list[Node], *, count: int, skins: int = 1, geometries: int = 0) -> list[Node]:
    """Let one cluster of weights for vertex 3 move the box, as often as there are skins."""
    objects, links = records
    objects.add("Model", 3, "bone\0\x01Model", "LimbNode")
    cluster = objects.add("Deformer", 4, "", "Cluster")
    cluster.add("Transform", np.eye(4).ravel())
    cluster.add("Indexes", np.full(count, 3, "<i4"))
    cluster.add("Weights", np.full(count, 0.5))
    links.add("C", "OO", 3, 4)
    for skin in range(1000, 1000 + skins):
        objects.add("Deformer", skin, "", "Skin")
        links.add("C", "OO", 4, skin)
        links.add("C", "OO", skin, 2)
    for number in range(2000, 2000 + geometries):
        objects.add("Geometry", number, "", "Mesh")
        links.add("C", "OO", 1000, number)
    return records


def scene_of(records: list[Node]) -> Scene:
    return build_scene("a.fbx", read_records("a.fbx", encode(records)))


def json_of(records: list[Node]) -> dict[str, Any]:
    content = convert_to_glb("a.fbx", encode(records))
    return json.loads(content[20 : 20 + struct.unpack_from("<I", content, 12)[0]])


def test_weights_are_counted_before_they_are_unpacked(monkeypatch):
    monkeypatch.setattr(limits, "WEIGHTS", 100)
    monkeypatch.setattr(geometry, "unpack", None)
    check_bindings(scene_of(bind(box(), count=20, geometries=4)))
    for count, geometries in ((101, 0), (21, 4)):
        with pytest.raises(FormatError, match="more than 100 weights") as caught:
            check_bindings(scene_of(bind(box(), count=count, geometries=geometries)))
        assert caught.value.code is Code.LIMIT_TOTAL
    monkeypatch.setattr(geometry, "MOST_BONES", 4)
    with pytest.raises(FormatError, match="or 4 bones of meshes"):
        check_bindings(scene_of(bind(box(), count=1, geometries=4)))


def test_a_cluster_of_many_skins_moves_a_mesh_once():
    scene = scene_of(bind(box(), count=1, skins=50))
    binding = read_binding(scene, scene.things[2], read_surface(scene, scene.things[2]))
    assert binding.bones == [3]
    np.testing.assert_allclose(binding.weights.sum(axis=1), [0, 0, 0, 0.5])


def test_points_that_no_polygon_uses_are_dropped_with_their_weights():
    scene = scene_of(bind(box(1, 2, -4, points=np.r_[SQUARE, np.zeros(3000)]), count=1))
    surface = read_surface(scene, scene.things[2])
    assert (len(surface.points), surface.given) == (3, 1004)
    corners = surface.points[surface.point_of[surface.faces[0]]]
    np.testing.assert_array_equal(corners, SQUARE.reshape(4, 3)[1:])
    binding = read_binding(scene, scene.things[2], surface)
    np.testing.assert_allclose(binding.weights.sum(axis=1), [0, 0, 0.5])


def test_nodes_that_show_one_geometry_share_its_skin():
    objects, links = bind(box(), count=1)
    for number in range(5000, 5010):
        objects.add("Model", number, "again\0\x01Model", "Mesh")
        links.add("C", "OO", 2, number)
    found = json_of([objects, links])
    assert [node.get("mesh") for node in found["nodes"]] == [0, None, *[0] * 10]
    assert len(found["skins"]) == 1


def many(count: int) -> list[Node]:
    """Let many nodes show one geometry, each at another place."""
    objects, links = box()
    for number in range(5000, 5000 + count):
        model = objects.add("Model", number, "again\0\x01Model", "Mesh")
        properties(model, GeometricTranslation=[float(number), 0.0, 0.0])
        links.add("C", "OO", 2, number)
    return [objects, links]


@pytest.mark.parametrize(
    ("limit", "most", "words"),
    [
        ("PIECES", 10, "11 meshes are shown, at most 10 are read"),
        ("REPEATED", 39, "more than 39 vertices are shown again"),
        ("VERTICES", 43, "more than 43 vertices"),
    ],
)
def test_copies_are_counted_before_they_are_written(monkeypatch, limit, most, words):
    assert len(json_of(many(10))["meshes"]) == 11
    monkeypatch.setattr(limits, limit, most)
    with pytest.raises(FormatError, match=words):
        convert_to_glb("a.fbx", encode(many(10)))


def test_materials_are_counted_once(monkeypatch):
    objects, links = box()
    layer = objects.inside[1].add("LayerElementMaterial", 0)
    layer.add("MappingInformationType", "AllSame")
    layer.add("Materials", np.array([7], "<i4"))
    properties(objects.add("Material", 9, "m", ""), DiffuseColor=[1.0, 0, 0])
    scene = scene_of([objects, links])
    assert scene.material_count == 1
    monkeypatch.setattr(Scene, "of", None)
    assert set(read_surface(scene, scene.things[2]).part_of) == {1}


def test_colours_are_linear_as_blender_and_ufbx_read_them():
    objects, links = box()
    properties(objects.add("Material", 9, "grey", ""), DiffuseColor=[0.5, 0.5, 0.5])
    links.add("C", "OO", 9, 1)
    (material,) = json_of([objects, links])["materials"]
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [0.5, 0.5, 0.5, 1]


def test_polygons_of_two_corners_are_left_out_aloud(tmp_path, caplog):
    records = box(0, -2, 0, 1, -3, -4, 0, 2, -4)
    layer = records[0].inside[1].add("LayerElementUV", 0)
    layer.add("MappingInformationType", "ByPolygonVertex")
    layer.add("ReferenceInformationType", "Direct")
    layer.add("UV", np.arange(18.0))
    scene = scene_of(records)
    surface = read_surface(scene, scene.things[2])
    assert "2 polygons have fewer than three corners; they are left out" in caplog.text
    np.testing.assert_array_equal(surface.point_of[surface.faces], [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(surface.uvs[surface.faces][:, 0], [[4, 5], [12, 13]])
    (tmp_path / "a.fbx").write_bytes(encode(box(0, -2)))
    with pytest.raises(FormatError) as caught:
        read_figure(tmp_path / "a.fbx")
    assert caught.value.code is Code.MESH_EMPTY


@pytest.mark.parametrize(
    ("name", "value"),
    [("Translation", np.nan), ("Rotation", np.nan), ("Scaling", np.inf), ("Scaling", 1e300)],
)
def test_a_mesh_that_is_placed_by_no_numbers_is_refused(name, value):
    with pytest.raises(FormatError, match="places its mesh by numbers that are not fin") as caught:
        json_of(box(**{f"Geometric{name}": [value] * 3}))
    assert caught.value.code is Code.NODE_TRANSFORM

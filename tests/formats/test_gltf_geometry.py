import numpy as np
import pytest

from bunraku import limits
from bunraku.formats.gltf import geometry, read_figure
from bunraku.types import FormatError
from tests.formats.made_gltf import TRIANGLE, Made, made_arm, made_triangle

FIVE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], np.float32)


def show(*primitives, made, **node):
    made.add("meshes", primitives=list(primitives))
    made.add("nodes", mesh=len(made.json["meshes"]) - 1, **node)
    return made


@pytest.mark.parametrize(
    ("mode", "faces"),
    [
        (4, [[0, 1, 2]]),  # the two corners that remain are cut
        (5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0]]),
    ],
)
def test_triangles_strips_and_fans(mode, faces, caplog):
    made = Made()
    show(made.primitive(FIVE) | {"mode": mode}, made=made)
    found = read_figure("m.glb", made.glb()).mesh.faces
    np.testing.assert_array_equal(found, faces)
    assert ("no whole triangles" in caplog.text) == (mode == 4)


def test_all_triangles_of_a_strip_face_one_way():
    made = Made()
    show(made.primitive(FIVE) | {"mode": 5}, made=made)
    mesh = read_figure("m.glb", made.glb()).mesh
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()


def test_strips_joined_by_empty_triangles_lose_them():
    made = Made()
    primitive = made.primitive(FIVE, [0, 1, 2, 2, 2, 3, 4]) | {"mode": 5}
    show(primitive, made=made)
    found = read_figure("m.glb", made.glb()).mesh.faces
    np.testing.assert_array_equal(found, [[0, 1, 2], [2, 3, 4]])


def test_every_node_shows_its_own_copy_in_world_space():
    made = made_triangle()
    made.json["nodes"][0] |= {"translation": [10, 0, 0], "children": [1]}
    made.add("nodes", mesh=0, translation=[0, 5, 0])
    figure = read_figure("m.glb", made.glb())
    np.testing.assert_allclose(figure.mesh.vertices[:3], np.add(TRIANGLE, [10, 0, 0]))
    np.testing.assert_allclose(figure.mesh.vertices[3:], np.add(TRIANGLE, [10, 5, 0]))
    np.testing.assert_array_equal(figure.mesh.faces, [[0, 1, 2], [3, 4, 5]])
    np.testing.assert_array_equal(figure.pieces, [0, 0, 0, 1, 1, 1])


def test_only_the_default_scene_is_read():
    made = made_triangle()
    made.add("nodes", mesh=0)
    made.add("scenes", nodes=[1])
    assert len(read_figure("m.glb", made.glb()).mesh.vertices) == 3
    del made.json["scenes"], made.json["scene"]
    assert len(read_figure("m.glb", made.glb()).mesh.vertices) == 6


def test_mirrored_nodes_keep_their_outside_outside():
    made = made_triangle()
    made.json["nodes"][0]["scale"] = [-1, 1, 1]
    np.testing.assert_array_equal(read_figure("m.glb", made.glb()).mesh.faces, [[2, 1, 0]])


def test_primitives_over_one_vertex_buffer_share_their_vertices():
    made = Made()
    first = made.primitive(FIVE, [[0, 1, 2]])
    second = first | {"indices": made.array([1, 3, 2], "SCALAR", store="u2")}
    other = made.primitive(TRIANGLE, [[0, 1, 2]])
    show(first, other, second, made=made)
    figure = read_figure("m.glb", made.glb())
    assert len(figure.mesh.vertices) == 5 + 3
    np.testing.assert_array_equal(figure.mesh.faces, [[0, 1, 2], [1, 3, 2], [5, 6, 7]])


def test_points_and_lines_beside_a_surface_are_left_out_aloud(caplog):
    made = Made()
    show(made.primitive(TRIANGLE), made.primitive(FIVE) | {"mode": 1}, made=made)
    assert len(read_figure("m.glb", made.glb()).mesh.vertices) == 3
    assert "/meshes/0/primitives/1: points or lines" in caplog.text


def test_a_file_of_points_is_a_point_cloud(caplog):
    made = Made()
    show(made.primitive(FIVE) | {"mode": 0}, made=made)
    mesh = read_figure("m.glb", made.glb()).mesh
    assert (len(mesh.vertices), len(mesh.faces)) == (5, 0)
    assert "point cloud" in caplog.text


@pytest.mark.parametrize(
    ("limit", "most", "words"),
    [
        ("PIECES", 4, "nodes show 5 meshes, at most 4 are read"),
        ("REPEATED", 11, "nodes show more than 11 vertices again"),
        ("VERTICES", 14, "more than 14 vertices"),
    ],
)
def test_copies_are_counted_before_they_are_read(monkeypatch, limit, most, words):
    made = made_triangle()
    for _ in range(4):
        made.json["scenes"][0]["nodes"].append(made.add("nodes", mesh=0))
    assert len(read_figure("m.glb", made.glb()).mesh.vertices) == 15
    monkeypatch.setattr(limits, limit, most)
    monkeypatch.setattr(geometry, "read_positions", None)
    with pytest.raises(FormatError, match=words):
        read_figure("m.glb", made.glb())


def test_corners_of_faces_that_share_few_vertices_are_counted(monkeypatch):
    made = Made()
    show(made.primitive(TRIANGLE, np.zeros((30, 3))), made=made)
    monkeypatch.setattr(limits, "VERTICES", 15)
    with pytest.raises(FormatError, match="zero area"):  # so many are read
        read_figure("m.glb", made.glb())
    monkeypatch.setattr(limits, "VERTICES", 14)
    with pytest.raises(FormatError, match="more than 84 corners of faces"):
        read_figure("m.glb", made.glb())


def test_sets_of_weights_are_counted():
    made = made_arm()
    names = made.json["meshes"][0]["primitives"][0]["attributes"]
    for number in range(1, 8):
        names[f"JOINTS_{number}"], names[f"WEIGHTS_{number}"] = (
            names["JOINTS_0"],
            names["WEIGHTS_0"],
        )
    assert read_figure("arm.glb", made.glb()).document.blocks[0].weights.shape == (4, 32)
    names["JOINTS_8"], names["WEIGHTS_8"] = names["JOINTS_0"], names["WEIGHTS_0"]
    with pytest.raises(FormatError, match="more than 32 joints move a vertex"):
        read_figure("arm.glb", made.glb())


def test_world_from_file_turns_everything():
    turn = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])
    figure = read_figure("m.glb", made_triangle().glb(), world_from_file=turn)
    np.testing.assert_allclose(figure.mesh.vertices, [[0, 0, 0], [1, 0, 0], [0, 0, -1]])


def test_quantised_positions_are_placed_by_their_node():
    made = Made()
    raw = made.array([[0, 0, 0], [32767, 0, 0], [0, 32767, 0]], "VEC3", store="i2", normalized=True)
    show({"attributes": {"POSITION": raw}}, made=made, scale=[2, 2, 2])
    np.testing.assert_allclose(read_figure("m.glb", made.glb()).mesh.vertices, 2 * TRIANGLE)


@pytest.mark.parametrize(
    ("vertices", "faces", "where", "message"),
    [
        ([[0, 0, 0], [1, np.nan, 0], [0, 1, 0]], None, "/accessors/0", "first 1; repair"),
        ([[0, 0, 0], [1, np.inf, 0], [0, 1, 0]], None, "/accessors/0", "first 1; repair"),
        (TRIANGLE, [[0, 1, 3]], "/accessors/1", "index 2 is vertex 3 of 3"),
        (TRIANGLE * 0, [[0, 1, 2]], "/meshes", "zero area"),
    ],
)
def test_damaged_geometry_is_refused(vertices, faces, where, message):
    made = Made()
    primitive = made.primitive(np.nan_to_num(np.array(vertices), posinf=0.0), faces)
    made.binary[: 4 * 9] = np.array(vertices, "<f4").tobytes()
    show(primitive, made=made)
    with pytest.raises(FormatError, match=message) as caught:
        read_figure("m.glb", made.glb())
    assert caught.value.where == where


def test_a_file_that_shows_nothing_is_refused():
    with pytest.raises(FormatError, match="no mesh is shown"):
        read_figure("m.glb", Made().glb())


@pytest.mark.parametrize(
    ("nodes", "where", "message"),
    [
        ([{"children": [1]}, {"children": [2]}, {"children": [0]}], "/nodes/0", "own ancestor"),
        ([{"children": [2]}, {"children": [2]}, {}], "/nodes/1/children/0", "two parents, 0 and 1"),
        ([{"children": [0]}], "/nodes/0", "own ancestor"),
        ([{"rotation": [0, 0, 0, 0]}], "/nodes/0/rotation", "zero quaternion"),
        ([{"matrix": [0] * 15 + [1]}], "/nodes/0/matrix", "flattens"),
        (
            [{"matrix": [1, 0, 0, 5, *[0, 1, 0, 0], *[0, 0, 1, 0], *[0, 0, 0, 1]]}],
            "/nodes/0/matrix",
            "last row",
        ),
        ([{"translation": [0, 1]}], "/nodes/0/translation", "length"),
    ],
)
def test_nodes_that_cannot_be_placed_are_refused(nodes, where, message):
    made = made_triangle()
    made.json["nodes"] = nodes
    made.json["scenes"] = [{"nodes": [0]}]
    with pytest.raises(FormatError, match=message) as caught:
        read_figure("m.glb", made.glb())
    assert caught.value.where == where


def test_a_long_chain_of_nodes_is_walked_without_recursion():
    made = made_triangle()
    made.json["nodes"] = [{"children": [i + 1], "translation": [1, 0, 0]} for i in range(5000)]
    made.add("nodes", mesh=0)
    made.json["scenes"] = [{"nodes": [0]}]
    vertices = read_figure("m.glb", made.glb()).mesh.vertices
    np.testing.assert_allclose(vertices, np.add(TRIANGLE, [5000, 0, 0]))


def test_matrix_and_parts_place_alike():
    made = made_triangle()
    made.json["nodes"][0] |= {
        "translation": [1, 2, 3],
        "rotation": [0, 0, 1, 0],
        "scale": [2, 2, 2],
    }
    expected = read_figure("m.glb", made.glb()).mesh.vertices
    matrix = [-2, 0, 0, 0, 0, -2, 0, 0, 0, 0, 2, 0, 1, 2, 3, 1]
    made.json["nodes"][0] = {"mesh": 0, "matrix": matrix}
    np.testing.assert_allclose(read_figure("m.glb", made.glb()).mesh.vertices, expected, atol=1e-12)


def rewrite(made, name, values, store="f4"):
    """Replace the values of an attribute of the arm."""
    primitive = made.json["meshes"][0]["primitives"][0]
    primitive["attributes"][name] = made.array(values, "VEC4", store=store)
    return made


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        (np.tile([2.0, 0, 0, 0], (4, 1)), "do not sum to 1; normalised"),
        (np.tile([1.0, np.nan, 0, 0], (4, 1)), "NaN or negative; repaired"),
        (np.tile([1.0, -0.5, 0, 0], (4, 1)), "NaN or negative; repaired"),
    ],
)
def test_damaged_weights_are_repaired_aloud(weights, message, caplog):
    made = rewrite(made_arm(), "WEIGHTS_0", weights)
    block = read_figure("arm.glb", made.glb()).document.blocks[0]
    np.testing.assert_allclose(block.weights, np.tile([1.0, 0, 0, 0], (4, 1)))
    assert message in caplog.text


def test_vertices_without_weights_follow_their_neighbours(caplog):
    weights = np.zeros((4, 4))
    weights[3, 0] = weights[0, 0] = 1.0  # joints 1 and 0
    made = rewrite(made_arm(), "WEIGHTS_0", weights)
    block = read_figure("arm.glb", made.glb()).document.blocks[0]
    np.testing.assert_allclose(block.weights.sum(axis=1), 1.0)
    assert block.joints[0, 0] == 0
    assert block.joints[3, 0] == 1
    assert "2 vertices without weights" in caplog.text


def test_bytes_are_shares_of_255():
    made = rewrite(made_arm(), "WEIGHTS_0", np.tile([255, 0, 0, 0], (4, 1)), "u1")
    made.json["accessors"][-1]["normalized"] = True
    block = read_figure("arm.glb", made.glb()).document.blocks[0]
    np.testing.assert_array_equal(block.weights, np.tile([1.0, 0, 0, 0], (4, 1)))


def test_two_sets_of_weights_are_read_side_by_side():
    made = made_arm()
    rewrite(made, "WEIGHTS_0", np.full((4, 4), 0.125))
    rewrite(made, "WEIGHTS_1", np.full((4, 4), 0.125))
    rewrite(made, "JOINTS_1", np.ones((4, 4)), "u1")
    block = read_figure("arm.glb", made.glb()).document.blocks[0]
    assert block.weights.shape == (4, 8)
    np.testing.assert_array_equal(block.joints[:, 4:], 1)


def test_odd_sets_of_weights_are_announced(caplog):
    made = made_arm()
    del made.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"]
    assert not read_figure("arm.glb", made.glb()).document.blocks[0].is_skinned
    assert "do not come in pairs" in caplog.text
    assert "has a skin but no weights" in caplog.text


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (np.full((4, 4), 9), "vertex 0 uses joint 9 of a skin of 2"),
        (np.zeros((3, 4)), "one row for each of 4 vertices"),
    ],
)
def test_joints_that_do_not_exist_are_refused(joints, message):
    made = rewrite(made_arm(), "JOINTS_0", joints, "u1")
    with pytest.raises(FormatError, match=message):
        read_figure("arm.glb", made.glb())

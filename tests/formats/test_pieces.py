import json

import numpy as np

from bunraku.formats.pieces import Material, Piece, encode_pieces, linear_from_srgb, turn_piece

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2]])


def split(glb):
    size = int.from_bytes(glb[12:16], "little")
    assert glb[:4] == b"glTF"
    assert int.from_bytes(glb[8:12], "little") == len(glb)
    return json.loads(glb[20 : 20 + size]), glb[28 + size :]


def array(document, binary, number):
    accessor = document["accessors"][number]
    view = document["bufferViews"][accessor["bufferView"]]
    kind = {5126: np.float32, 5125: np.uint32}[accessor["componentType"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    flat = np.frombuffer(binary, kind, accessor["count"] * width, view["byteOffset"])
    return flat.reshape(-1, width)


def test_everything_that_a_piece_has_is_in_the_file():
    piece = Piece(
        "hat",
        TRIANGLE,
        FACES,
        normals=np.tile([0.0, 0, 2], (3, 1)),
        uvs=np.array([[0.0, 0], [1, 0], [0, 1]]),
        colours=np.array([[1.0, 0, 0.5]] * 3),
        material=0,
    )
    document, binary = split(encode_pieces([piece], [Material("felt", (0.5, 0.0, 0.0, 0.5))]))
    (primitive,) = document["meshes"][0]["primitives"]
    stored = {n: array(document, binary, i) for n, i in primitive["attributes"].items()}
    np.testing.assert_array_equal(stored["POSITION"], TRIANGLE)
    np.testing.assert_array_equal(stored["NORMAL"], np.tile([0, 0, 1], (3, 1)))
    np.testing.assert_array_equal(stored["TEXCOORD_0"], [[0, 1], [1, 1], [0, 0]])
    np.testing.assert_allclose(stored["COLOR_0"][0], [1, 0, 0.21404], atol=1e-5)
    np.testing.assert_array_equal(array(document, binary, primitive["indices"]).ravel(), [0, 1, 2])
    assert document["accessors"][0]["max"] == [1.0, 1.0, 0.0]
    assert document["nodes"] == [{"name": "hat", "mesh": 0}]
    material = document["materials"][primitive["material"]]
    assert material["alphaMode"] == "BLEND"
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [0.5, 0, 0, 0.5]


def test_materials_that_share_a_picture_store_it_once():
    image = b"\x89PNG...."
    twice = [Material("a", image=image), Material("b", image=image)]
    document, binary = split(encode_pieces([Piece("", TRIANGLE, FACES)], twice))
    assert len(document["images"]) == 1
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    assert binary[view["byteOffset"] :][: view["byteLength"]] == image
    assert document["images"][0]["mimeType"] == "image/png"


def test_normals_without_direction_are_left_out():
    piece = Piece("", TRIANGLE, FACES, normals=np.zeros((3, 3)))
    document, _ = split(encode_pieces([piece]))
    assert set(document["meshes"][0]["primitives"][0]["attributes"]) == {"POSITION"}


def test_points_have_no_indices():
    document, _ = split(encode_pieces([Piece("", TRIANGLE, np.empty((0, 3), np.int64))]))
    assert document["meshes"][0]["primitives"] == [{"attributes": {"POSITION": 0}, "mode": 0}]


def test_turning_turns_normals_too():
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    piece = turn_piece(Piece("", TRIANGLE, FACES, normals=TRIANGLE), quarter)
    np.testing.assert_array_equal(piece.positions[1], [0, 1, 0])
    np.testing.assert_array_equal(piece.normals, piece.positions)


def test_srgb_is_straight_near_black_and_keeps_its_ends():
    found = linear_from_srgb(np.array([0.0, 0.04045, 0.5, 1.0]))
    np.testing.assert_allclose(found, [0, 0.04045 / 12.92, 0.214041, 1], atol=1e-6)

import numpy as np
import pytest

from bunraku.formats.meshes import read_pieces
from bunraku.formats.ply_polygons import split_polygons
from bunraku.types import FormatError

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)


def make(polygons, order="<", tail=b""):
    name = {"<": "little", ">": "big"}[order]
    header = f"ply\nformat binary_{name}_endian 1.0\nelement vertex 4\n"
    header += "property float x\nproperty float y\nproperty float z\n"
    header += f"element face {len(polygons)}\nproperty uchar flag\n"
    header += "property list uchar int vertex_indices\nend_header\n"
    rows = [
        b"\7" + bytes([len(polygon)]) + np.array(polygon, order + "i4").tobytes()
        for polygon in polygons
    ]
    return header.encode() + SQUARE.astype(order + "f4").tobytes() + b"".join(rows) + tail


@pytest.mark.parametrize("order", ["<", ">"])
def test_quads_and_triangles_in_one_file(order):
    pieces, _ = read_pieces("a.ply", make([[0, 1, 2, 3], [0, 1, 2], [2, 3, 0]], order), "ply")
    np.testing.assert_array_equal(pieces[0].positions, SQUARE)
    assert pieces[0].faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2], [2, 3, 0]]


def test_even_polygons_are_left_to_the_library():
    content = make([[0, 1, 2], [2, 3, 0]])
    assert split_polygons("a.ply", content) == (content, None)
    pieces, _ = read_pieces("a.ply", content, "ply")
    assert pieces[0].faces.tolist() == [[0, 1, 2], [2, 3, 0]]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (make([[0, 1, 2, 3], [0, 1, 2]])[:-2], "face 1: has 3 corners where the file ends"),
        (make([[0, 1, 2, 3], [0, 1]], tail=b"\0" * 9), "face 1: has 2 corners"),
        (make([[0, 1, 2, 3], [0, 1, 9]]), "face 1: has a corner that is no vertex"),
        (make([[0, 1, 2, -3], [0, 1, 2]]), "face 0: has a corner that is no vertex"),
    ],
)
def test_damaged_polygons_are_named(content, message):
    with pytest.raises(FormatError, match=message):
        read_pieces("a.ply", content, "ply")

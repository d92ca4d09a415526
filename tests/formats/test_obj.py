import logging

import numpy as np
import pytest

from bunraku.formats.obj import read_obj, unite_corners
from bunraku.types import FormatError

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def read(text, path="a.obj"):
    pieces, _ = read_obj(path, text.encode() if isinstance(text, str) else text)
    return pieces


def test_vertices_keep_their_order_and_a_quad_becomes_two_triangles():
    (piece,) = read(SQUARE + "f 4 3 2 1\n")
    np.testing.assert_array_equal(piece.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    assert piece.faces.tolist() == [[3, 2, 1], [3, 1, 0]]
    assert piece.uvs is None
    assert piece.normals is None


def test_vertices_double_along_seams_only():
    text = SQUARE + "vt 0 0\nvt 1 0\nvt 1 1\nvt .5 .5\nvn 0 0 1\n"
    (piece,) = read(text + "f 1/1/1 2/2/1 3/3/1\nf 1/1/1 3/4/1 4/2/1\n")
    assert len(piece.positions) == 5  # only vertex 3 has two UVs
    np.testing.assert_array_equal(piece.positions[2], piece.positions[3])
    np.testing.assert_array_equal(piece.uvs[2:4], [[1, 1], [0.5, 0.5]])
    np.testing.assert_array_equal(piece.normals, np.tile([0, 0, 1], (5, 1)))


def test_groups_and_materials_are_pieces(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    text = (
        "mtllib a.mtl\n" + SQUARE + "o cup\nusemtl red\nf 1 2 3\nusemtl blue\nf 1 3 4\n"
        "g hat\nf 2 3 4\no cup\nusemtl red\nf 1 2 4\n"
    )
    pieces, materials = read_obj(tmp_path / "a.obj", text.encode())
    assert [(p.name, p.material, len(p.faces)) for p in pieces] == [
        ("cup", 0, 2),
        ("cup", 1, 1),
        ("hat", 1, 1),
    ]
    assert [(m.name, m.colour) for m in materials] == [
        ("red", (1.0, 0.0, 0.0, 1.0)),
        ("blue", (0.0, 0.0, 1.0, 1.0)),
    ]
    np.testing.assert_array_equal(pieces[2].positions, [[1, 0, 0], [1, 1, 0], [0, 1, 0]])


@pytest.mark.parametrize(
    "text",
    [
        SQUARE.replace("\n", "\r\n") + "f 1 2 3\r\n",
        SQUARE.replace("\n", "\r") + "f 1 2 3",
        SQUARE.replace(" ", "\t") + "f\t1 2  3 # comment",
        SQUARE + "f 1 \\\n2 \\\n3\n",
        SQUARE + "f -4 -3 -2\n",
        "f 1 2 3\n" + SQUARE,
        SQUARE.replace("0\n", "0 1.0\n") + "f 1 2 3",
        SQUARE + "f 1/ 2/ 3/",
        ("\ufeff" + SQUARE + "f 1 2 3").encode(),
        (SQUARE + "f 1 2 3").encode("utf-16"),
        ("o K\xf6rper\n" + SQUARE + "f 1 2 3").encode("latin-1"),
    ],
)
def test_dialects_say_the_same(text):
    (piece,) = read(text)
    np.testing.assert_array_equal(piece.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    assert piece.faces.tolist() == [[0, 1, 2]]


def test_relative_indices_count_from_their_own_line():
    (piece,) = read("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\n")
    np.testing.assert_array_equal(piece.positions, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_colours_are_fractions_whether_stored_as_bytes_or_not():
    for high in ("1", "255"):
        (piece,) = read(f"v 0 0 0 {high} 0 0\nv 1 0 0 0 {high} 0\nv 0 1 0\nf 1 2 3\n")
        np.testing.assert_array_equal(piece.colours, [[1, 0, 0], [0, 1, 0], [1, 1, 1]])


def test_indices_of_uvs_that_are_not_there_cost_only_the_uvs(caplog):
    with caplog.at_level(logging.WARNING):
        (piece,) = read(SQUARE + "vt 0 0\nf 1/9 2/1 3/1\n")
    assert piece.uvs is None
    assert "line 6: wanted vt indices from 1 to 1" in caplog.text


def test_a_continued_line_does_not_shift_the_numbers_of_later_lines():
    with pytest.raises(FormatError, match="line 8: wanted v indices"):
        read(SQUARE + "f 1 \\\n2 \\\n3\nf 1 2 9\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SQUARE, r"has no faces \(f lines\)"),
        (SQUARE + "f 1 2\n", "line 5: wanted at least three corners, got 'f 1 2'"),
        (SQUARE + "f 1 2 5\n", "line 5: wanted v indices from 1 to 4"),
        (SQUARE + "f 0 1 2\n", "line 5: wanted v indices from 1 to 4"),
        (SQUARE + "f -9 1 2\n", "line 5: wanted v indices from 1 to 4"),
        (SQUARE + "f 1 2 1e30\n", "line 5: wanted whole numbers such as 7/2/5"),
        (SQUARE + f"f 1 2 {10**30}\n", "line 5: wanted v indices from 1 to 4"),
        (SQUARE + "f 1 2 a/b\n", "line 5: wanted whole numbers"),
        (SQUARE + "f 1/1/1/1 2 3\n", "line 5: wanted whole numbers"),
        (SQUARE + "v 0 0\nf 1 2 3\n", "line 5: wanted v x y z, got 'v 0 0'"),
        (SQUARE + "v 0,5 0 0\nf 1 2 5\n", "line 5: wanted numbers with a decimal point"),
        (SQUARE + "v nan 0 0\nf 1 2 5\n", "line 5: wanted finite coordinates"),
        (SQUARE + "v 1e400 0 0\nf 1 2 5\n", "line 5: wanted finite coordinates"),
    ],
)
def test_an_error_names_its_line(text, message):
    with pytest.raises(FormatError, match=message):
        read(text)


@pytest.mark.parametrize("word", ["nan", "0,5", "3.1+e2", "1e400"])
def test_a_damaged_vertex_that_no_face_uses_is_left_out(caplog, word):
    (piece,) = read(SQUARE + f"v {word} 0 0\nf 1 2 3\n")
    assert len(piece.positions) == 3
    assert "1 vertices that no face uses are no numbers" in caplog.text


def test_words_in_names_are_no_keywords_and_hashes_no_comments():
    (piece,) = read("g v 1 2 #3\n" + SQUARE + "f 1 2 3 # f 4\n#f 1 2 9\n  \n\n")
    assert piece.name == "v 1 2 #3"


@pytest.mark.parametrize("indices", ["1/1/1 2//1 3/1", "1//1 2//1 3/1/1", "1/ 2/1/ 3//"])
def test_uneven_corners_are_read_one_by_one(indices):
    (piece,) = read(SQUARE + f"vt 0 0\nvn 0 0 1\nf {indices}\n")
    assert piece.faces.tolist() == [[0, 1, 2]]


def test_united_corners_agree_with_a_plain_loop(rng):
    part_of = np.repeat([0, 1], 30)
    corners = rng.integers(-1, 4, (60, 3))
    corners[:, 0] = np.abs(corners[:, 0])
    rows, faces = unite_corners(part_of, corners)
    every = [tuple(row) for row in np.column_stack([part_of, corners]).tolist()]
    plain = sorted(set(every))
    assert [tuple(row) for row in rows.tolist()] == plain
    assert faces.ravel().tolist() == [plain.index(row) for row in every]


def test_a_long_line_is_cut_in_the_message():
    with pytest.raises(FormatError) as caught:
        read(SQUARE + "f " + "x" * 5000)
    assert len(str(caught.value)) < 200


def test_a_face_without_corners_is_left_out(caplog):
    pieces, _ = read_obj("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf\ng b\nf 1 2 3\nf # 1\n")
    assert [piece.faces.tolist() for piece in pieces] == [[[0, 1, 2]]]
    assert [piece.name for piece in pieces] == ["b"]
    assert "line 5: 2 f lines name no corner" in caplog.text
    with pytest.raises(FormatError, match="has no faces"):
        read_obj("a.obj", b"v 0 0 0\nf\n")

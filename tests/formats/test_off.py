import numpy as np
import pytest

from bunraku.formats.off import read_off
from bunraku.types import FormatError

HEAD = b"OFF\n5 2 0\n0 0 0\n2 1 0\n0 2 0\n.5 1 0 255 0 0\n0 0 1\n"


def test_polygons_of_any_size_and_colours_behind_them():
    piece = read_off("a.off", HEAD + b"4 0 1 2 3 255 0 0\n3 0 1 4\n")
    assert len(piece.positions) == 5
    corners = piece.positions[piece.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert len(piece.faces) == 3
    assert (normals[:2, 2] > 0).all()  # the arrow head is cut inside, not fanned
    assert piece.faces[2].tolist() == [0, 1, 4]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (HEAD + b"3 0 1 5\n3 0 1 4\n", "face 0: wanted corners from 0 to 4, got '3 0 1 5'"),
        (HEAD + b"3 0 1 2\n3 0 1 -1\n", "face 1: wanted corners from 0 to 4"),
        (HEAD + b"3 0 1 2\n4 0 1 2\n", "face 1: wanted corners"),
        (HEAD + b"3 0 1 2\n2 0 1\n", "face 1: wanted corners"),
        (HEAD + b"3 0 1 2\n3 a b c\n", "face 1: wanted corners"),
        (HEAD.replace(b"2 1 0\n", b"2 x 0\n") + b"3 0 1 2\n" * 2, "vertex 1: wanted three numbers"),
        (HEAD.replace(b"2 1 0\n", b"2 1\n") + b"3 0 1 2\n" * 2, "vertex 1: wanted three numbers"),
    ],
)
def test_rows_that_make_no_sense_are_named(content, message):
    with pytest.raises(FormatError, match=message):
        read_off("a.off", content)


OFF = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


@pytest.mark.parametrize(
    "text",
    [
        b"# a comment\nOFF # another\n\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2",
        b"OFF 3 1 0\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n",
        b"COFF\n3 1\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ],
)
def test_off_dialects_become_one(text):
    piece, plain = read_off("a.off", text), read_off("a.off", OFF)
    np.testing.assert_array_equal(piece.positions, plain.positions)
    np.testing.assert_array_equal(piece.faces, plain.faces)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (OFF.replace(b"3 1 0", b"4000000000 1 0"), "counts: claim 4000000001 rows, the file has 4"),
        (OFF.replace(b"3 1 0", b"-3 1 0"), "counts: wanted vertex and face counts, got '-3 1 0'"),
        (OFF.replace(b"3 1 0", b"3 0 0"), "counts: has no faces"),
        (b"OFF BINARY\n\0\0", "line 1: wanted an ASCII OFF of three dimensions"),
        (b"4OFF\n3 1 0\n", "line 1: wanted an ASCII OFF"),
    ],
)
def test_damaged_off_headers_are_refused(content, message):
    with pytest.raises(FormatError, match=message):
        read_off("a.off", content)


def test_words_that_are_no_integers_may_stand_behind_the_corners():
    piece = read_off("a.off", OFF.replace(b"3 0 1 2", b"3 0 1 2 0.5 0.5 red"))
    assert piece.faces.tolist() == [[0, 1, 2]]


def test_what_follows_the_rows_is_left_out():
    piece = read_off("a.off", OFF + b"3 9 9 9\nand so on\n")
    assert (len(piece.positions), piece.faces.tolist()) == (3, [[0, 1, 2]])


def test_text_in_utf16_is_read():
    assert len(read_off("a.off", OFF.decode().encode("utf-16")).positions) == 3

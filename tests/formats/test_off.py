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

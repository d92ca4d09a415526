import numpy as np
import pytest

from bunraku.errors import Code
from bunraku.formats.headers import check_ply
from bunraku.formats.meshes import read_pieces
from bunraku.formats.ply_text import rewrite_as_binary
from bunraku.types import FormatError

HEAD = """ply
format ascii 1.0
element vertex 4
property float x
property double y
property float32 z
property uchar red
property uchar green
property uchar blue
element face 2
property list uchar int vertex_indices
end_header
"""
ROWS = "0 0 0 255 0 0\n1 0 0 0 255 0\n1 1e0 0 0 0 255\n0 1 -.5 0 0 0\n"
TRIANGLES = "3 0 1 2\n3 0 2 3\n"


def read(text):
    return read_pieces("a.ply", text.encode(), "ply")[0][0]


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_a_text_is_read_as_the_binary_file_that_it_becomes(line_end):
    text = (HEAD + ROWS + TRIANGLES).replace("\n", line_end)
    binary = rewrite_as_binary("a.ply", check_ply("a.ply", text.encode()))
    head = HEAD.replace("ascii", "binary_little_endian").replace("\n", line_end).encode()
    assert binary.startswith(head)
    assert len(binary) == len(head) + 4 * 19 + 2 * 13
    piece = read(text)
    np.testing.assert_allclose(piece.positions, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, -0.5]])
    assert piece.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    np.testing.assert_allclose(piece.colours[:, :3], [*np.eye(3), [0, 0, 0]])


@pytest.mark.parametrize(
    "rows",
    [
        ROWS.replace("255", "256", 1) + TRIANGLES,  # no uchar
        ROWS.replace("255", "1.5", 1) + TRIANGLES,
        ROWS + "4 0 1 2 3\n3 0 1 2\n",  # polygons of several sizes
    ],
)
def test_rows_that_do_not_fit_stay_text(rows):
    content = (HEAD + rows).encode()
    assert rewrite_as_binary("a.ply", content) == content
    spaced = (HEAD + "\n" + rows.replace("\n", "\n\n")).encode()
    assert rewrite_as_binary("a.ply", spaced) == content


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (ROWS + "3 0 1 2\n", "element face: the header counts 2 rows, the file has 1; give"),
        (ROWS[:28], "element vertex: the header counts 4 rows, the file has 2; give"),
        (ROWS.replace("\n", " ") + "\n" + TRIANGLES, "element vertex: .* the file has 3; give"),
        ((ROWS + TRIANGLES).replace(" ", "\n"), "vertex 0: wanted a number .* got '0'; export"),
        (ROWS.replace("1e0", "one") + TRIANGLES, "vertex 2: wanted a number .* got '1 one"),
        (ROWS.replace("255 0 0", "255 0", 1) + TRIANGLES, "vertex 0: wanted a number"),
        (ROWS + "4 0 1 2 3\n3 0 1\n", "face 1: wanted a number .* got '3 0 1'"),
        (ROWS + "4 0 1 2 3\n-1 0 1\n", "face 1: wanted a number"),
    ],
)
def test_a_text_that_is_cut_or_wrapped_is_refused(rows, message):
    with pytest.raises(FormatError, match=message) as caught:
        read(HEAD + rows + "\n" * 60)
    assert caught.value.code is Code.MESH_COUNT


def test_a_binary_file_stays_as_it_is():
    content = (HEAD.replace("ascii", "binary_little_endian") + ROWS).encode()
    assert rewrite_as_binary("a.ply", content) is content

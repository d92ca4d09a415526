import pytest

from bunraku.formats.headers import check_off, check_ply, check_stl
from bunraku.types import FormatError

PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)
OFF = b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
ASCII_STL = b"solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"


def test_sound_headers_pass():
    assert check_ply("a.ply", PLY) == PLY
    assert check_off("a.off", OFF).splitlines() == OFF.splitlines()
    assert b"endsolid" in check_stl("a.stl", ASCII_STL)
    binary = b"\0" * 80 + (1).to_bytes(4, "little") + b"\0" * 50
    assert check_stl("a.stl", binary) == binary


@pytest.mark.parametrize(
    "text",
    [
        b"# a comment\nOFF # another\n\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2",
        b"OFF 3 1 0\r\n0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n",
        b"COFF\n3 1\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    ],
)
def test_off_dialects_become_one(text):
    assert check_off("a.off", text).split() == OFF.split()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"vertex 3", b"vertex 4000000000", "element vertex: claims 4000000000 rows"),
        (b"face 1", b"face 99", "element face: claims 99 rows, more than the file has bytes for"),
        (b"vertex 3", b"vertex -1", "line 3: wanted element NAME COUNT, got 'element vertex -1'"),
        (b"vertex 3", b"vertex 0", "has no vertices"),
        (b"float x", b"floot x", "line 4: wanted property TYPE NAME, got 'property floot x'"),
        (b"ascii", b"utf8", "has format"),
        (b"end_header", b"", "has no end_header line"),
    ],
)
def test_damaged_ply_headers_are_refused(old, new, message):
    with pytest.raises(FormatError, match=message):
        check_ply("a.ply", PLY.replace(old, new, 1))


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
        check_off("a.off", content)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 51,
            "claims 4294967295 triangles, .* for 1.02;",
        ),
        (b"\0" * 84, "claims 0 triangles"),
        (b"\0" * 80, "claims 0 triangles, the file has bytes for 0"),
        (ASCII_STL.replace(b"1 0 0", b"1 x 0"), "line 5: wanted vertex x y z, got 'vertex 1 x 0'"),
        (ASCII_STL.replace(b"1 0 0", b"1 0"), "line 5: wanted vertex x y z"),
    ],
)
def test_damaged_stl_files_are_refused(content, message):
    with pytest.raises(FormatError, match=message):
        check_stl("a.stl", content)


@pytest.mark.parametrize("count", [0, 0xFFFFFFFF])
def test_an_stl_that_does_not_count_its_triangles_is_read_whole(caplog, count):
    records = b"\0" * 150
    content = check_stl("a.stl", b"\0" * 80 + count.to_bytes(4, "little") + records)
    assert content == b"\0" * 80 + (3).to_bytes(4, "little") + records
    assert "does not count the triangles; all 3 are read" in caplog.text


@pytest.mark.parametrize("tail", [1, 50, 100])
def test_what_follows_the_triangles_of_an_stl_is_no_triangle(caplog, tail):
    whole = b"\0" * 80 + (2).to_bytes(4, "little") + b"\1" * 100
    assert check_stl("a.stl", whole + b"\2" * tail) == whole
    assert f"{tail} bytes follow the 2 triangles of the header; they are left out" in caplog.text

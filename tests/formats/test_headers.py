import pytest

from bunraku.formats.headers import check_ply
from bunraku.types import FormatError

PLY = (
    b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)


def test_sound_headers_pass():
    assert check_ply("a.ply", PLY) == PLY


def test_a_header_of_carriage_returns_alone_gets_line_feeds():
    assert check_ply("a.ply", PLY.replace(b"\n", b"\r")).startswith(PLY[: PLY.index(b"0 0 0")])
    head = PLY[: PLY.index(b"0 0 0")].replace(b"ascii", b"binary_little_endian")
    body = b"\n" + bytes(11 + 24 + 13)  # begins as if the header's last line end went on
    assert check_ply("a.ply", head.replace(b"\n", b"\r") + body) == head + body


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

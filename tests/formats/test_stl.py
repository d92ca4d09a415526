import numpy as np
import pytest

from bunraku.formats import stl
from bunraku.formats.sniffing import sniff
from bunraku.formats.stl import check_stl, read_stl
from bunraku.types import FormatError

CORNERS = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
TEXT = b"solid a\nfacet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
TEXT += b"endloop\nendfacet\nendsolid a\n"


def test_a_text_and_a_binary_file_hold_the_same():
    records = np.zeros(1, stl.RECORD)
    records["corners"] = CORNERS
    binary = b"\0" * 80 + (1).to_bytes(4, "little") + records.tobytes()
    for content in (binary, TEXT, TEXT.replace(b"\n", b"\r\n"), TEXT.replace(b"\n", b"\r")):
        (piece,) = read_stl("a.stl", content)
        np.testing.assert_array_equal(piece.positions, CORNERS)
        assert piece.faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_marks_of_unicode_are_no_part_of_the_text(encoding):
    content = TEXT.decode().encode(encoding)
    assert sniff("a.stl", content) == "stl"
    (piece,) = read_stl("a.stl", content)
    assert (piece.name, piece.positions.tolist()) == ("a", CORNERS)


def test_a_binary_header_may_begin_as_a_text_does():
    for mark in (b"\xff\xfe", b"\xef\xbb\xbfsolid"):
        binary = mark.ljust(80, b"\0") + (1).to_bytes(4, "little") + bytes(50)
        assert len(read_stl("a.stl", binary)[0].faces) == 1


@pytest.mark.parametrize("chunk", [1, 40, 1 << 20])
def test_solids_are_pieces_however_the_text_is_cut(monkeypatch, chunk):
    monkeypatch.setattr(stl, "CHUNK", chunk)
    empty = b"solid vertex 7\nendsolid vertex 7\n"
    second = TEXT.replace(b"solid a", b"SOLID the hat").upper().replace(b"VERTEX", b"\tVertex")
    pieces = read_stl("a.stl", TEXT + empty + second + b"vertex 9 9 9\n")
    assert [piece.name for piece in pieces] == ["a", "THE HAT"]
    for piece in pieces:
        np.testing.assert_array_equal(piece.positions, CORNERS)


def test_corners_at_one_position_are_one_vertex_in_the_order_of_the_file():
    other = TEXT.replace(b"solid a\n", b"").replace(b"vertex 0 0 0", b"vertex 1 1 -0")
    (piece,) = read_stl("a.stl", TEXT.replace(b"endsolid a\n", b"") + other)
    assert piece.positions.tolist() == [*CORNERS, [1, 1, 0]]
    assert piece.faces.tolist() == [[0, 1, 2], [3, 1, 2]]


def test_neighbouring_numbers_are_different_vertices():
    rng = np.random.default_rng(0)
    values = np.float32(1) + np.arange(64, dtype=np.float32) * np.float32(2**-23)
    records = np.zeros(20000, stl.RECORD)
    records["corners"] = rng.choice(values, (20000, 3, 3))
    (piece,) = read_stl("a.stl", b"\0" * 80 + (20000).to_bytes(4, "little") + records.tobytes())
    corners = records["corners"].reshape(-1, 3)
    np.testing.assert_array_equal(piece.positions[piece.faces].reshape(-1, 3), corners)
    assert len(piece.positions) == len(np.unique(corners, axis=0))


def test_solids_are_counted(monkeypatch):
    monkeypatch.setattr(stl.limits, "PIECES", 1)
    assert len(read_stl("a.stl", TEXT)) == 1
    with pytest.raises(FormatError, match="has more than 1 solids; join them"):
        read_stl("a.stl", TEXT * 2)


def test_a_line_of_many_words_is_read_once():
    (piece,) = read_stl("a.stl", b"solid" + b" solid" * 200_000 + TEXT[7:])
    assert len(piece.positions) == 3


def test_triangles_are_counted(monkeypatch):
    monkeypatch.setattr(stl.limits, "VERTICES", 0)
    binary = b"\0" * 80 + (1).to_bytes(4, "little") + b"\0" * 50
    for content in (TEXT, binary):
        with pytest.raises(FormatError, match="has more than 0 triangles"):
            read_stl("a.stl", content)


def test_numbers_that_only_python_reads_are_read():
    (piece,) = read_stl("a.stl", TEXT.replace(b"vertex 1 0 0", b"vertex 1_0 0 0"))
    assert piece.positions[1].tolist() == [10, 0, 0]


def test_a_text_that_breaks_off_is_told(caplog):
    (piece,) = read_stl("a.stl", TEXT[: TEXT.index(b"endloop")])
    assert len(piece.positions) == 3
    assert "line 7: ends without endsolid" in caplog.text


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            b"\0" * 80 + b"\xff\xff\xff\xff" + b"\0" * 51,
            "claims 4294967295 triangles, .* for 1.02;",
        ),
        (b"\0" * 84, "claims 0 triangles"),
        (b"\0" * 80, "claims 0 triangles, the file has bytes for 0"),
        (TEXT.replace(b"1 0 0", b"1 x 0"), "line 5: wanted vertex .* got 'vertex 1 x 0'"),
        (TEXT.replace(b"\nvertex", b" vertex"), "line 3: wanted vertex x y z on a line of its own"),
        (TEXT.replace(b"\n", b" "), "line 1: has no line breaks between its facets"),
        (TEXT.replace(b"1 0 0", b"1 0"), "line 5: wanted vertex x y z"),
        (TEXT.replace(b"1 0 0", b"1 vertex 0 0"), "line 5: wanted vertex x y z"),
        (TEXT.replace(b"vertex 1 0 0\n", b""), "line 1: 2 vertices are no whole triangles"),
    ],
)
def test_damaged_stl_files_are_refused(content, message):
    with pytest.raises(FormatError, match=message):
        read_stl("a.stl", content)


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

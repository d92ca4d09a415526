import logging

import numpy as np
import pytest
import trimesh

from bunraku import limits
from bunraku.formats.meshes import encode_obj, encode_ply, merge_pieces, read_pieces
from bunraku.formats.pieces import Piece
from bunraku.meshes import face_normals
from bunraku.types import FormatError, Mesh

HEADER = "ply\nformat ascii 1.0\nelement vertex 4\n"
XYZ = "property float x\nproperty float y\nproperty float z\n"
COLOUR = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
QUAD = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n"


def read_one(content, kind):
    pieces, _ = read_pieces(f"a.{kind}", content, kind)
    (piece,) = pieces
    return piece


def exported(mesh, kind, **options):
    content = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(
        file_type=kind, **options
    )
    return content.encode() if isinstance(content, str) else content


@pytest.mark.parametrize("kind", ["obj", "ply", "off"])
def test_files_of_another_program_keep_order(cube, kind):
    piece = read_one(exported(cube, kind), kind)
    np.testing.assert_allclose(piece.positions, cube.vertices, atol=1e-6)
    np.testing.assert_array_equal(piece.faces, cube.faces)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_an_stl_that_another_program_wrote_is_the_mesh(cube, kind):
    piece = read_one(exported(cube, kind), "stl")
    assert len(piece.positions) == 8
    np.testing.assert_allclose(piece.positions[piece.faces], cube.vertices[cube.faces])


@pytest.mark.parametrize(("encode", "kind"), [(encode_obj, "obj"), (encode_ply, "ply")])
def test_what_is_written_is_read_here_and_elsewhere(cube, rng, encode, kind):
    mesh = Mesh(cube.vertices + rng.normal(size=(8, 3)), cube.faces)
    piece = read_one(encode(mesh), kind)
    np.testing.assert_allclose(piece.positions, mesh.vertices, rtol=1e-6)
    np.testing.assert_array_equal(piece.faces, mesh.faces)
    other = trimesh.load(trimesh.util.wrap_as_stream(encode(mesh)), file_type=kind, process=False)
    np.testing.assert_allclose(other.vertices, mesh.vertices, rtol=1e-6)


def test_groups_are_counted(monkeypatch):
    monkeypatch.setattr(limits, "PIECES", 1)
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\ng a\nf 1 2 3\n"
    assert len(read_pieces("a.obj", text, "obj")[0]) == 1
    with pytest.raises(FormatError, match="has 2 groups, at most 1 are read; join them"):
        read_pieces("a.obj", text + b"g b\nf 1 2 3\n", "obj")


def test_a_ply_without_faces_is_a_point_cloud(cube, caplog):
    cloud = Mesh(cube.vertices, np.empty((0, 3), np.int64))
    with caplog.at_level(logging.WARNING):
        piece = read_one(encode_ply(cloud), "ply")
    assert piece.faces.shape == (0, 3)
    np.testing.assert_array_equal(piece.positions, cube.vertices)
    assert "has no faces; it is taken as a point cloud" in caplog.text


def test_quads_and_colours_of_a_ply():
    text = HEADER + XYZ + COLOUR + FACE + QUAD.replace("0\n", "0 255 0 0\n", 4)
    piece = read_one(text.encode(), "ply")
    assert piece.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    np.testing.assert_array_equal(piece.colours[:, :3], np.tile([1, 0, 0], (4, 1)))


def test_carriage_returns_alone_end_lines_of_a_ply():
    text = (HEADER + XYZ + FACE + QUAD).replace("\n", "\r")
    assert read_one(text.encode(), "ply").faces.tolist() == [[0, 1, 2], [0, 2, 3]]


def test_triangle_strips_are_never_lost_in_silence(caplog):
    strips = "element tristrips 1\nproperty list int int vertex_indices\n"
    text = HEADER + XYZ + strips + "end_header\n" + QUAD
    with pytest.raises(FormatError, match="element tristrips: triangle strips are not read"):
        read_one(text.encode(), "ply")
    text = HEADER + XYZ + FACE.replace("end_header", f"{strips}end_header") + QUAD + "3 0 1 2\n"
    assert len(read_one(text.encode(), "ply").faces) == 2
    assert "triangle strips are not read" in caplog.text


def test_pieces_merge_with_their_faces_shifted(cube):
    piece = Piece("a", cube.vertices, cube.faces)
    mesh = merge_pieces([piece, piece])
    np.testing.assert_array_equal(mesh.faces[12:], cube.faces + 8)
    np.testing.assert_array_equal(mesh.vertices[8:], cube.vertices)


@pytest.mark.parametrize(
    ("content", "kind", "message"),
    [
        (
            HEADER + XYZ + FACE + QUAD.replace("4 0 1 2 3", "4 0 1 2 9"),
            "ply",
            "face 0: has a corner that is no",
        ),
        (HEADER + XYZ + FACE + QUAD.replace("4 0 1 2 3", "3 0 1 -1"), "ply", r"face 0: is \[0, 1"),
        (HEADER + XYZ + FACE + QUAD.replace("1 1 0", "1 nan 0"), "ply", "vertex 2: is"),
        (HEADER + XYZ + FACE + QUAD.replace("1 1 0", "1 1"), "ply", "vertex 2: wanted a number"),
        (
            HEADER
            + XYZ
            + FACE.replace("property", "property int y\nproperty")
            + QUAD.replace("4 0 1 2 3", "4 0 1 2"),
            "ply",
            "face 0: has fewer than three corners",
        ),
        ("v 0 0 0\nv 1 0 0\nv 0 1e300 0\nf 1 2 3", "obj", "vertex 2: is"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "off", "face 0|damaged OFF"),
    ],
)
def test_geometry_that_means_nothing_is_refused(content, kind, message):
    with pytest.raises(FormatError, match=message):
        read_pieces(f"a.{kind}", content.encode(), kind)


def test_too_many_vertices_are_refused(cube, monkeypatch):
    monkeypatch.setattr("bunraku.limits.VERTICES", 7)
    with pytest.raises(FormatError, match="has 8 vertices, at most 7; decimate it"):
        read_pieces("a.obj", encode_obj(cube), "obj")


@pytest.mark.parametrize("sides", [3, 4, 5, 7])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_polygons_of_any_one_size_are_cut(sides, encoding):
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(sides)]).astype("<f4")
    header = (
        f"ply\nformat {encoding} 1.0\nelement vertex {sides}\nproperty float x\n"
        "property float y\nproperty float z\nelement face 1\n"
        "property list uchar int vertex_indices\nend_header\n"
    ).encode()
    if encoding == "ascii":
        rows = [" ".join(map(str, row)) for row in ring.tolist()]
        body = "\n".join([*rows, f"{sides} {' '.join(map(str, range(sides)))}", ""]).encode()
    else:
        body = ring.tobytes() + bytes([sides]) + np.arange(sides, dtype="<i4").tobytes()
    pieces, _ = read_pieces("a.ply", header + body, "ply")
    area = np.linalg.norm(face_normals(pieces[0].positions, pieces[0].faces), axis=1).sum() / 2
    assert len(pieces[0].faces) == sides - 2
    assert area == pytest.approx(sides / 2 * np.sin(2 * np.pi / sides), rel=1e-5)

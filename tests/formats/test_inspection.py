import json

import msgspec
import numpy as np
import pytest
import trimesh

from bunraku.errors import Code
from bunraku.formats import inspect, read_figure, write_mesh
from bunraku.formats.inspection import ClipSummary
from bunraku.types import FormatError, Mesh
from tests.depth_folders import OURS, ball, write_folder
from tests.formats.made_gltf import made_triangle
from tests.fuzz.mutants import make_rigged


@pytest.fixture
def told(tmp_path):
    def inspect_mesh(mesh, name="a.ply"):
        write_mesh(tmp_path / name, mesh)
        return inspect(tmp_path / name)

    return inspect_mesh


def codes(found):
    return {fault.code: fault for fault in found.faults}


@pytest.mark.parametrize("name", ["a.obj", "a.ply", "a.glb"])
def test_a_closed_cube_is_sound(told, cube, name):
    found = told(cube, name)
    assert (found.kind, found.vertices, found.faces, found.parts) == ("figure", 8, 12, 1)
    assert found.closed
    assert (found.boundary_edges, found.non_manifold_edges) == (0, 0)
    assert found.extent == pytest.approx((1.0, 1.0, 1.0))
    assert (found.low, found.high) == (pytest.approx((0, 0, 0)), pytest.approx((1, 1, 1)))
    assert found.facing in ("+z", "-y")
    assert set(codes(found)) == {"MESH_FEW_FACES"}
    assert found.bytes > 0


def test_it_goes_into_json(told, cube):
    text = msgspec.json.encode(told(cube))
    assert json.loads(text)["faults"][0]["severity"] == "note"


def test_an_open_cube_has_a_boundary(told, cube):
    found = told(Mesh(cube.vertices, cube.faces[2:]))
    assert not found.closed
    assert found.boundary_edges == 4
    assert codes(found)["MESH_OPEN"].message == "4 edges have one face only: it is open"


def test_parts_are_counted_after_welding(told, cube):
    apart = Mesh(cube.vertices[cube.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    found = told(apart)
    assert found.parts == 1
    assert found.closed
    assert (found.vertices, found.welded_vertices) == (36, 8)
    two = Mesh(
        np.concatenate([cube.vertices, cube.vertices + 3]),
        np.concatenate([cube.faces, cube.faces + 8]),
    )
    assert told(two).parts == 2


def test_a_fin_is_not_manifold(told, cube):
    fin = Mesh(
        np.concatenate([cube.vertices, [[-1.0, -1, 0]]]), np.concatenate([cube.faces, [[0, 1, 8]]])
    )
    found = told(fin)
    assert found.non_manifold_edges == 1
    assert not found.closed


def test_a_turned_face_is_found(told, cube):
    faces = cube.faces.copy()
    faces[0] = faces[0, ::-1]
    found = told(Mesh(cube.vertices, faces))
    assert "MESH_TURNED" in codes(found)
    assert not found.closed


def test_odd_geometry_is_reported(told, cube):
    vertices = np.concatenate([cube.vertices, [[9.0, 9, 9]]])
    faces = np.concatenate([cube.faces, cube.faces[:1], [[0, 0, 1]]])
    found = told(Mesh(vertices, faces))
    assert codes(found)["MESH_UNUSED"].message == "1 vertices belong to no face"
    assert codes(found)["MESH_DOUBLED"].severity == "note"
    assert codes(found)["MESH_ZERO_AREA"].severity == "warning"
    assert found.extent == pytest.approx((1.0, 1.0, 1.0))  # stray vertices do not count
    sheet = told(Mesh(cube.vertices * [1, 1, 0], cube.faces))
    assert "MESH_FLAT" in codes(sheet)


def test_points_are_a_warning(told):
    found = told(Mesh(ellipsoid(2 * np.pi).vertices, np.empty((0, 3), np.int64)))
    assert codes(found)["MESH_POINTS"].severity == "warning"
    assert not found.closed


def test_pieces_materials_and_up_of_an_obj(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl red\nKd 1 0 0\n")
    rows = ["mtllib a.mtl", "v 0 0 0", "v 1 0 0", "v 0 1 0", "g a", "f 1 2 3", "g b", "f 3 2 1"]
    (tmp_path / "a.obj").write_text("\n".join(rows))
    found = inspect(tmp_path / "a.obj")
    assert (found.pieces, found.materials, found.textures, found.up) == (2, 1, 0, "y")


def test_a_motion_tells_its_clip(tmp_path):
    joint = "{ OFFSET 0 1 0 CHANNELS 3 Zrotation Xrotation Yrotation "
    text = f"HIERARCHY ROOT a {joint} JOINT a {joint} }} }} MOTION Frames: 3 Frame Time: 0.5 "
    (tmp_path / "walk.bvh").write_text(text + "0 " * 18)
    found = inspect(tmp_path / "walk.bvh")
    assert (found.kind, found.joints) == ("motion", 2)
    assert found.clips[0] == type(found.clips[0])("walk", 1.0, 3)
    assert "1 joints have a name that another joint has" in [
        fault.message for fault in found.faults
    ]


def test_a_folder_of_depth_frames_is_told_from_any_folder(tmp_path):
    with pytest.raises(FormatError, match=r"is a folder without NNNN\.png frames"):
        inspect(tmp_path)
    found = inspect(write_folder(tmp_path / "video", ball(5)))
    assert (found.kind, found.pixels, found.masked, found.faults) == ("depth", (64, 48), False, ())
    assert found.clips == (ClipSummary("video", 4 / 30, 5),)
    assert found.view_degrees == pytest.approx((56.1, 43.6), abs=0.1)
    assert found.depth_metres == pytest.approx((1.5, 1.5))


def test_what_is_odd_about_a_depth_video_is_told(tmp_path):
    frames = ball(4)
    frames[2] = 0
    assert set(codes(inspect(write_folder(tmp_path / "a", frames)))) == {"DEPTH_SUBJECT"}
    gap = write_folder(tmp_path / "b", ball(3), numbers=[0, 1, 5])
    assert set(codes(inspect(gap))) == {"DEPTH_FRAMES"}
    assert codes(inspect(gap))["DEPTH_FRAMES"].severity == "note"
    far = write_folder(tmp_path / "d", ball(3) * 20, OURS | {"depth_scale": 1000})
    assert set(codes(inspect(far))) == {"DEPTH_INTRINSICS"}
    still = write_folder(tmp_path / "e", np.repeat(ball(1), 3, axis=0))
    assert "nothing moves" in codes(inspect(still))["DEPTH_SUBJECT"].message
    jumping = write_folder(tmp_path / "f", ball(12)[::11].repeat(2, axis=0)[[0, 2, 1, 3]])
    assert "is elsewhere in the next frame" in codes(inspect(jumping))["DEPTH_SUBJECT"].message


@pytest.mark.parametrize(
    ("frames", "words"),
    [
        (ball(1), "has a single frame, which shows no motion"),
        (np.full((3, 48, 64), 1500), "all depths are alike: a bare wall"),
        (np.random.default_rng(0).integers(500, 5000, (3, 48, 64)), "this is noise"),
        (np.minimum(ball(3), 2), "depth reaches 0.002 m only"),
    ],
)
def test_a_depth_video_that_shows_nothing_is_refused(tmp_path, frames, words):
    with pytest.raises(FormatError, match=words):
        inspect(write_folder(tmp_path / "a", frames))


def test_a_file_with_nothing_in_it_is_refused(tmp_path):
    (tmp_path / "a.gltf").write_text('{"asset": {"version": "2.0"}}')
    with pytest.raises(FormatError, match="shows no mesh and holds no rig"):
        inspect(tmp_path / "a.gltf")


def test_a_surface_without_area_is_a_warning_and_no_figure(told, tmp_path):
    line = Mesh(np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]]), np.array([[0, 1, 2]]))
    for name in ("a.obj", "a.ply", "a.glb"):
        assert codes(told(line, name))["MESH_NO_AREA"].severity == "warning"
        with pytest.raises(FormatError, match="every triangle has zero area") as caught:
            read_figure(tmp_path / name)
        assert caught.value.code is Code.MESH_NO_AREA
    with pytest.raises(FormatError, match="all vertices lie at one point"):
        told(Mesh(np.ones((3, 3)), line.faces))


def test_a_rig_without_a_surface_tells_its_joints_and_clips(tmp_path):
    made = make_rigged()
    del made.json["nodes"][2]["mesh"], made.json["nodes"][2]["skin"], made.json["meshes"]
    (tmp_path / "moves.glb").write_bytes(made.glb())
    found = inspect(tmp_path / "moves.glb")
    assert codes(found)["RIG_NO_SURFACE"].severity == "warning"
    assert (found.joints, found.bind, found.vertices) == (2, "same", 0)
    assert found.clips[0].name == "wave"
    assert np.isfinite(found.high).all()


def test_a_rig_that_moves_nothing_and_has_no_surface_is_refused(tmp_path):
    made = make_rigged()
    del made.json["nodes"][2]["mesh"], made.json["nodes"][2]["skin"], made.json["meshes"]
    del made.json["animations"]
    (tmp_path / "bones.glb").write_bytes(made.glb())
    with pytest.raises(FormatError, match="holds 2 joints and 0 clips, but no surface") as caught:
        inspect(tmp_path / "bones.glb")
    assert caught.value.code is Code.RIG_NO_SURFACE


def test_a_figure_below_the_floor_or_on_its_back_is_told(told, cube):
    upright = (cube.vertices - [0.5, 0, 0.5]) * [1, 3, 0.3]
    upside_down = Mesh(upright * [1, -1, -1], cube.faces)
    assert "stand on its head" in codes(told(upside_down, "a.glb"))["MESH_UP"].message
    lying = Mesh(upright[:, [0, 2, 1]], cube.faces[:, ::-1].copy())
    found = codes(told(lying, "a.glb"))["MESH_UP"]
    assert "the figure may lie" in found.message
    assert found.severity == "warning"
    afloat = codes(told(Mesh(lying.vertices + np.array([0, 0, 5]), lying.faces), "a.glb"))[
        "MESH_UP"
    ]
    assert afloat.severity == "note"


def ellipsoid(turn: float) -> Mesh:
    """Turn a half circle about y, from the plane of x and y on: half a body, or a whole one."""
    heights, turns = np.linspace(0, np.pi, 14), np.pi / 2 + np.linspace(0, turn, 15)
    around = np.sin(heights)[:, None]
    rows = np.broadcast_arrays(
        around * np.cos(turns), 2 * np.cos(heights)[:, None], 0.8 * around * np.sin(turns)
    )
    number = np.arange(14 * 15).reshape(14, 15)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.concatenate([np.stack(f, axis=-1).reshape(-1, 3) for f in ((a, b, c), (a, c, d))])
    mesh = trimesh.Trimesh(np.stack(rows, axis=-1).reshape(-1, 3).round(12), faces)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    return Mesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64))


def test_half_a_body_is_told(told):
    half = ellipsoid(np.pi)
    assert "apply the mirror" in codes(told(half, "a.obj"))["MESH_HALF"].message
    bust = Mesh(half.vertices[:, [1, 0, 2]] * [1, -1, 1], half.faces)
    assert "MESH_HALF" not in codes(told(bust, "a.glb"))
    assert "MESH_HALF" not in codes(told(ellipsoid(2 * np.pi), "a.obj"))


@pytest.mark.parametrize(
    ("cloud", "words"),
    [
        (np.random.default_rng(0).random((99, 3)), "99 points are too few"),
        (np.random.default_rng(0).random((10, 3)).repeat(50, axis=0), "10 points are too few"),
        (np.random.default_rng(0).random((200, 3)) * [1, 1, 0], "200 points lie in a plane"),
    ],
)
def test_a_cloud_that_shows_no_body_is_refused_by_all(told, tmp_path, cloud, words):
    mesh = Mesh(cloud, np.zeros((0, 3), np.int64))
    with pytest.raises(FormatError, match=words):
        told(mesh, "a.ply")
    with pytest.raises(FormatError, match=words):
        read_figure(tmp_path / "a.ply")


def test_a_crushed_figure_is_a_warning_and_a_sheet_a_note(told):
    body = ellipsoid(2 * np.pi)
    for thickness, severity in ((1e-6, "warning"), (0.0, "note")):
        crushed = Mesh(body.vertices * [1, 1, thickness], body.faces)
        assert codes(told(crushed, "a.obj"))["MESH_FLAT"].severity == severity


def test_positions_that_are_not_stored_are_a_note(tmp_path):
    made = made_triangle()
    primitive = made.json["meshes"][0]["primitives"][0]
    for accessor in (made.json["accessors"][i] for i in primitive["attributes"].values()):
        del accessor["bufferView"]
    (tmp_path / "a.glb").write_bytes(made.glb())
    found = inspect(tmp_path / "a.glb")
    assert [(f.code, f.severity) for f in found.faults] == [("MESH_NO_AREA", "note")]
    assert (found.vertices, found.faces) == (3, 1)
    with pytest.raises(FormatError, match="every triangle has zero area"):
        read_figure(tmp_path / "a.glb")
    del made.json["nodes"][0]["mesh"]  # neither stored nor shown: nothing is there
    (tmp_path / "a.glb").write_bytes(made.glb())
    with pytest.raises(FormatError, match="shows no mesh and holds no rig"):
        inspect(tmp_path / "a.glb")

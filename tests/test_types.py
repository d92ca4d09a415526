import numpy as np
import pytest

from bunraku.types import (
    Character,
    Clip,
    DepthVideo,
    Figure,
    FormatError,
    Mesh,
    Skeleton,
    Skin,
)


def still(name: str, joints: int, *, times: tuple[float, ...] = (0.0, 0.5)) -> Clip:
    frames = len(times)
    quaternions = np.tile([0.0, 0.0, 0.0, 1.0], (frames, joints, 1))
    parts = np.zeros((frames, joints, 3)), quaternions, np.ones((frames, joints, 3))
    return Clip(name, np.array(times), *parts)


def test_format_error_is_one_line_a_user_can_act_on():
    error = FormatError("walk.glb", "/skins/0", "has no joints; export it again")
    assert str(error) == "walk.glb: /skins/0: has no joints; export it again"
    assert isinstance(error, ValueError)


def test_format_error_about_a_whole_file_names_no_place():
    assert str(FormatError("walk.glb", "", "is empty")) == "walk.glb: is empty"


def test_point_cloud_is_a_mesh_without_faces(rng):
    assert len(Mesh(rng.normal(size=(5, 3)), np.zeros((0, 3), np.int64)).faces) == 0


@pytest.mark.parametrize("wrong", [-1, 3])
def test_mesh_names_the_face_whose_corner_does_not_exist(wrong):
    faces = np.array([[0, 1, 2], [0, 1, wrong]])
    message = rf"face 1 is \[0, 1, {wrong}\], but there are 3 vertices, counted from 0"
    with pytest.raises(ValueError, match=message):
        Mesh(np.eye(3), faces)


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_mesh_names_the_first_vertex_that_is_not_finite(wrong):
    vertices = np.eye(3)
    vertices[1:, 2] = wrong
    with pytest.raises(ValueError, match="vertices must be finite; 2 are not, first 1"):
        Mesh(vertices, np.array([[0, 1, 2]]))


@pytest.mark.usefixtures("as_user")
@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.eye(2), [[0, 1, 0]], r"vertices must have shape \(2, 3\) \(x, y, z each\)"),
        (np.eye(3), [[0, 1]], r"faces must have shape \(1, 3\) \(three corners each\)"),
    ],
)
def test_mesh_explains_a_wrong_shape(vertices, faces, message):
    with pytest.raises(ValueError, match=message):
        Mesh(vertices, np.array(faces))


@pytest.mark.parametrize(
    ("parents", "message"),
    [
        ([-1, 2, 1], r"joint 1 \('elbow'\) has parent 2: .* sort the joints root first"),
        ([-1, 0, -2], r"joint 2 \('wrist'\) has parent -2: a parent must be -1 \(a root\)"),
        ([-1, 0], r"parents must have shape \(3,\) \(one per name\), got \(2,\)"),
    ],
)
@pytest.mark.usefixtures("as_user")
def test_skeleton_explains_what_is_wrong(arm, parents, message):
    with pytest.raises(ValueError, match=message):
        Skeleton(arm.names, np.array(parents), arm.rest)


@pytest.mark.usefixtures("as_user")
def test_skeleton_needs_one_matrix_per_name(arm):
    with pytest.raises(ValueError, match=r"rest must have shape \(3, 4, 4\) .*got \(2, 4, 4\)"):
        Skeleton(arm.names, arm.parents, arm.rest[:2])


def test_skeleton_names_the_joint_whose_rest_is_not_finite(arm):
    rest = arm.rest.copy()
    rest[2, 0, 3] = np.nan
    with pytest.raises(ValueError, match="rest must be finite; 1 are not, first 2"):
        Skeleton(arm.names, arm.parents, rest)


@pytest.mark.parametrize(
    ("row", "total"), [([0.5, 0.0], r"0\.5000"), ([1.5, -0.5], r"1\.0000"), ([np.nan, 1.0], "nan")]
)
def test_skin_names_the_first_vertex_whose_weights_are_wrong(row, total):
    with pytest.raises(ValueError, match=rf"1 vertices do not \(vertex 1 sums to {total}\)"):
        Skin(np.array([[1.0, 0.0], row]), np.tile(np.eye(4), (2, 1, 1)))


@pytest.mark.usefixtures("as_user")
def test_skin_needs_one_matrix_per_joint():
    with pytest.raises(ValueError, match=r"inverse_bind must have shape \(2, 4, 4\)"):
        Skin(np.array([[1.0, 0.0]]), np.eye(4)[None])


@pytest.mark.parametrize("times", [(), (0.0, 0.0), (0.5, 0.0)])
def test_clip_needs_rising_times(times):
    with pytest.raises(ValueError, match="clip 'Walk' needs at least one frame, and rising times"):
        still("Walk", 3, times=times)


def test_clip_names_its_part_that_is_not_finite():
    clip = still("Walk", 3)
    clip.scales[1, 2] = np.inf
    with pytest.raises(ValueError, match="clip 'Walk' scales must be finite; 1 are not, first 1"):
        Clip(clip.name, clip.times, clip.translations, clip.rotations, clip.scales)


@pytest.mark.usefixtures("as_user")
@pytest.mark.parametrize("part", ["times", "translations", "scales"])
def test_clip_names_its_part_of_another_length(part):
    clip = still("Walk", 3)
    parts = {name: getattr(clip, name) for name in ("times", "translations", "rotations", "scales")}
    with pytest.raises(ValueError, match=f"{part} must have shape"):
        Clip("Walk", **parts | {part: parts[part][:1]})


def test_character_needs_one_row_of_weights_per_vertex(arm, arm_skin):
    mesh = Mesh(np.zeros((6, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match=r"skin.weights must have shape \(6, 3\)"):
        Character(mesh, arm, arm_skin)


def test_character_needs_clips_of_its_own_joints(arm, arm_skin):
    mesh = Mesh(np.zeros((7, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="clip 'Walk' moves 2 joints, the skeleton has 3"):
        Character(mesh, arm, arm_skin, (still("Idle", 3), still("Walk", 2)))


def test_figure_needs_one_piece_number_per_vertex(cube):
    with pytest.raises(ValueError, match=r"pieces must have shape \(8,\) \(one per vertex\)"):
        Figure("cube.obj", cube, np.zeros(7, np.int64))


def test_a_depth_video_is_checked_once(as_user):
    depths, lens = np.ones((3, 4, 5)), np.eye(3)
    times = np.array([0.0, 0.1, 0.2])
    assert DepthVideo("x", times, depths, lens).masks is None
    for wrong, words in (
        ((times[:2], depths, lens, None), "times must have shape"),
        ((times[::-1], depths, lens, None), "rising times"),
        ((times, depths, lens[:2], None), "intrinsics must have shape"),
        ((times, depths, np.full((3, 3), np.nan), None), "intrinsics must be finite"),
        ((times, depths, lens, np.ones((3, 4, 4), bool)), "masks must have shape"),
    ):
        with pytest.raises(ValueError, match=words):
            DepthVideo("x", *wrong)

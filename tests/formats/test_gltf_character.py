import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.formats.gltf import describe, read_character, read_figure
from bunraku.rotations import compose_transforms
from bunraku.skinning import forward_kinematics, play_clip
from bunraku.types import FormatError
from tests.formats.made_gltf import TRIANGLE, Made, made_arm, made_triangle


def test_bending_the_elbow_of_the_arm():
    """A case small enough to work out by hand."""
    character = read_character("arm.glb", made_arm().glb())
    assert character.skeleton.names == ("shoulder", "elbow")
    np.testing.assert_array_equal(character.skeleton.parents, [-1, 0])
    np.testing.assert_allclose(character.skin.weights, [[1, 0], [0.5, 0.5], [0, 1], [0, 1]])
    posed = play_clip(character, character.clips[0])
    np.testing.assert_allclose(posed[0], [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0]], atol=1e-7)
    np.testing.assert_allclose(posed[1], [[0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 1, 0]], atol=1e-7)


def pose_plainly(made, moved, vertices, weights, joints, inverse_bind):
    """Pose a skin as the specification says, one vertex at a time.

    `moved` gives the translation, rotation and scale of some nodes at one moment.
    """
    nodes = made.json["nodes"]

    def world(node):
        item = nodes[node] | moved.get(node, {})
        rotation = Rotation.from_quat(item.get("rotation", [0, 0, 0, 1])).as_matrix()
        scale = np.array(item.get("scale", [1, 1, 1]), float)
        local = compose_transforms(
            np.array(item.get("translation", [0, 0, 0]), float), rotation, scale
        )
        above = [i for i, other in enumerate(nodes) if node in other.get("children", [])]
        return world(above[0]) @ local if above else local

    motion = [world(node) @ bind for node, bind in zip(joints, inverse_bind, strict=True)]
    return np.array(
        [
            sum(w * (m @ [*vertex, 1.0])[:3] for w, m in zip(row, motion, strict=True))
            for vertex, row in zip(vertices, weights, strict=True)
        ]
    )


def quaternion(axis, degrees):
    return Rotation.from_euler(axis, degrees, degrees=True).as_quat().tolist()


def made_export(node_pose=(0.0, 0.0)):
    """A leg as exporters make them: hundredths, Z up, an armature of scale 100, a chain between.

    0 armature (scaled, turned, with root motion) > 1 hip > 2 spacer, no joint > 3 knee; 4 the mesh.
    `node_pose` turns hip and knee away from the bind pose, in degrees.
    """
    made = Made()
    vertices = np.array([[0, 0, 0.02], [0.001, 0, 0.01], [0, 0.001, 0.0], [0.001, 0.001, 0.015]])
    rows = [[1, 0], [0.5, 0.5], [0, 1], [0.8, 0.2]]
    weights = made.weights(np.tile([0, 1, 0, 0], (4, 1)), np.pad(rows, ((0, 0), (0, 2))))
    made.add("meshes", primitives=[made.primitive(vertices, [[0, 1, 2], [1, 3, 2]], **weights)])
    turn = quaternion("x", -90)
    made.add("nodes", name="armature", children=[1], scale=[100, 100, 100], rotation=turn)
    bend = quaternion("y", node_pose[0])
    made.add("nodes", name="hip", children=[2], translation=[0, 0, 0.02], rotation=bend)
    made.add("nodes", name="spacer", children=[3], translation=[0, 0, -0.004])
    bend = quaternion("y", node_pose[1])
    made.add("nodes", name="knee", translation=[0, 0, -0.006], rotation=bend)
    made.add("nodes", name="body", mesh=0, skin=0, scale=[100, 100, 100], rotation=turn)
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[:, 2, 3] = -0.02, -0.01
    made.skin([1, 3], bind)
    made.add("scenes", nodes=[0, 4])
    return made, vertices, np.array(rows), bind


WALK = (
    (0, "translation", [0, 1], [[0, 0, 0], [0, 0, 3]], "LINEAR"),
    (1, "rotation", [0, 1], [quaternion("x", 0), quaternion("x", 70)], "LINEAR"),
    (2, "rotation", [0, 1], [quaternion("y", 0), quaternion("y", 40)], "LINEAR"),
    (3, "rotation", [0, 1], [quaternion("z", 0), quaternion("z", -50)], "LINEAR"),
)


@pytest.mark.parametrize("growth", [1.0, 1.5])
@pytest.mark.parametrize("tracks", [WALK, WALK[:2] + WALK[3:]], ids=["bent chain", "stiff chain"])
def test_clips_agree_with_the_specification(tracks, growth):
    """Root motion on the armature, scale 100, Z up and nodes between joints: all in the clip."""
    made, vertices, weights, bind = made_export()
    made.json["nodes"][2]["scale"] = [growth] * 3  # since the mesh was bound
    made.clip("walk", *tracks)
    character = read_character("leg.glb", made.glb())
    clip = character.clips[0]
    posed = play_clip(character, clip)
    for frame in (0, len(clip.times) // 2, len(clip.times) - 1):
        moved = {}
        for node, path, times, values, _ in tracks:
            share = np.interp(clip.times[frame], times, [0, 1])
            if path == "rotation":
                turn = Rotation.from_quat(values[1]).as_rotvec()
                moved[node] = {path: Rotation.from_rotvec(share * turn).as_quat()}
            else:
                moved[node] = {path: share * np.array(values[1])}
        expected = pose_plainly(made, moved, vertices, weights, [1, 3], bind)
        np.testing.assert_allclose(posed[frame], expected, atol=2e-6)


def test_joint_frames_are_rigid_and_metres():
    character = read_character("leg.glb", made_export()[0].glb())
    world = forward_kinematics(character.skeleton.parents, character.skeleton.rest)
    np.testing.assert_allclose(world[:, :3, 3], [[0, 2, 0], [0, 1, 0]], atol=1e-6)
    gram = np.swapaxes(world[:, :3, :3], 1, 2) @ world[:, :3, :3]
    np.testing.assert_allclose(gram, np.tile(np.eye(3), (2, 1, 1)), atol=1e-6)
    np.testing.assert_allclose(world @ character.skin.inverse_bind, [np.eye(4)] * 2, atol=1e-12)
    assert np.ptp(character.mesh.vertices[:, 1]) == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("pose", [(3, 2), (3, 60), (170, 20), (-30, 50)])
def test_geometry_is_that_of_the_bind_pose_whatever_the_nodes_do(pose):
    expected = read_figure("leg.glb", made_export()[0].glb()).mesh.vertices
    content = made_export(pose)[0].glb()
    np.testing.assert_allclose(read_figure("leg.glb", content).mesh.vertices, expected, atol=1e-6)
    mesh = read_character("leg.glb", content).mesh
    np.testing.assert_allclose(mesh.vertices, expected, atol=1e-6)


def test_most_of_the_body_places_the_mesh_where_its_node_says_nothing():
    made, vertices, *_ = made_export((0, 60))
    made.json["nodes"][4]["scale"] = [1, 1, 1]
    found = read_figure("leg.glb", made.glb()).mesh.vertices
    np.testing.assert_allclose(found, 100 * vertices[:, [0, 2, 1]] * [1, 1, -1], atol=1e-6)


def test_clips_do_not_depend_on_the_default_pose():
    posed = []
    for pose in ((0, 0), (20, 60)):
        made = made_export(pose)[0]
        full = [(1, "rotation", [0, 1], [quaternion("x", 0), quaternion("x", 70)], "LINEAR")]
        full += [(3, "rotation", [0, 1], [quaternion("y", 5), quaternion("y", 9)], "LINEAR")]
        made.clip("walk", *full)
        character = read_character("leg.glb", made.glb())
        posed.append(play_clip(character, character.clips[0]))
    np.testing.assert_allclose(*posed, atol=2e-6)


def test_unskinned_meshes_follow_the_joint_they_hang_on():
    made = made_arm()
    made.add("meshes", primitives=[made.primitive(TRIANGLE, [[0, 1, 2]])])
    made.json["nodes"][2]["children"] = [3]
    made.add("nodes", mesh=1, translation=[1, 0, 0])
    character = read_character("arm.glb", made.glb())
    np.testing.assert_allclose(character.mesh.vertices[4:], np.add(TRIANGLE, [2, 0, 0]), atol=1e-7)
    np.testing.assert_array_equal(character.skin.weights[4:], [[0, 1]] * 3)
    posed = play_clip(character, character.clips[0])[1, 4:]
    np.testing.assert_allclose(posed, [[1, 1, 0], [1, 2, 0], [0, 1, 0]], atol=1e-7)
    same = read_figure("arm.glb", made.glb()).mesh.vertices
    np.testing.assert_allclose(same, character.mesh.vertices)


def test_animated_nodes_without_a_skin_are_joints():
    made = made_triangle()
    made.add("nodes", name="lid", mesh=0, translation=[0, 1, 0])
    made.add("nodes", name="box", children=[0, 1])
    made.json["scenes"][0]["nodes"] = [2]
    half = np.sqrt(0.5)
    made.clip("open", (1, "rotation", [0, 1], [[0, 0, 0, 1], [0, 0, half, half]], "LINEAR"))
    character = read_character("box.glb", made.glb())
    assert character.skeleton.names == ("box", "lid")
    np.testing.assert_array_equal(character.skin.weights, [[1, 0]] * 3 + [[0, 1]] * 3)
    posed = play_clip(character, character.clips[0])[1]
    np.testing.assert_allclose(posed[:3], TRIANGLE)
    np.testing.assert_allclose(posed[3:], [[0, 1, 0], [0, 2, 0], [-1, 1, 0]], atol=1e-7)


def test_a_rig_without_a_mesh_is_an_empty_character():
    made = made_arm()
    del made.json["meshes"], made.json["nodes"][0]["mesh"], made.json["nodes"][0]["skin"]
    character = read_character("arm.glb", made.glb())
    assert character.mesh.vertices.shape == (0, 3)
    assert character.skeleton.names == ("shoulder", "elbow")
    assert len(character.clips) == 1


def test_missing_inverse_binds_are_the_identity():
    made = made_arm()
    del made.json["skins"][0]["inverseBindMatrices"]
    made.json["nodes"][2]["translation"] = [0, 0, 0]
    character = read_character("arm.glb", made.glb())
    np.testing.assert_allclose(character.skin.inverse_bind, [np.eye(4)] * 2)


def test_several_skins_over_the_same_joints_are_one_skeleton():
    made = made_arm()
    made.json["meshes"].append(made.json["meshes"][0])
    moved = np.tile(np.eye(4), (2, 1, 1))
    moved[1, 0, 3] = -1
    moved[:, :3, 3] += [0, -5, 0]  # a mesh stored five metres higher, with the joints swapped
    made.skin([2, 1], moved[::-1])
    made.add("nodes", mesh=1, skin=1)
    made.json["scenes"][0]["nodes"].append(3)
    character = read_character("arm.glb", made.glb())
    assert character.skeleton.names == ("shoulder", "elbow")
    np.testing.assert_allclose(character.skin.weights[4:], character.skin.weights[:4, ::-1])
    expected = character.mesh.vertices[:4] - [0, 5, 0]
    np.testing.assert_allclose(character.mesh.vertices[4:], expected, atol=1e-6)


def test_a_mesh_bound_in_another_pose_is_brought_into_the_common_one(caplog):
    made = made_arm()
    primitive = dict(made.json["meshes"][0]["primitives"][0])
    upright = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 1, 0]], np.float32)  # elbow bent
    primitive["attributes"] = primitive["attributes"] | {
        "POSITION": made.array(upright, "VEC3"),
        "WEIGHTS_0": made.array([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], "VEC4"),
    }
    made.add("meshes", primitives=[primitive])
    bent = np.tile(np.eye(4), (2, 1, 1))
    elbow = compose_transforms(
        np.array([1.0, 0, 0]), Rotation.from_euler("z", 90, degrees=True).as_matrix()
    )
    bent[1] = np.linalg.inv(elbow)
    made.skin([1, 2], bent)
    made.add("nodes", mesh=1, skin=1)
    made.json["scenes"][0]["nodes"].append(3)
    character = read_character("arm.glb", made.glb())
    expected = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0]]
    np.testing.assert_allclose(character.mesh.vertices[4:], expected, atol=1e-6)
    assert "bound in another pose" in caplog.text


def test_missing_and_repeated_names_become_unique():
    made = made_arm()
    made.json["nodes"][1].pop("name")
    made.json["nodes"][2]["name"] = "joint_1"
    assert read_character("arm.glb", made.glb()).skeleton.names == ("joint_1", "joint_1_2")
    made.json["animations"][0].pop("name")
    assert read_character("arm.glb", made.glb()).clips[0].name == "clip_0"


def test_clips_of_other_things_are_not_the_characters():
    made = made_arm()
    made.add("nodes", name="camera")
    made.clip("fly", (3, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR"))
    assert [clip.name for clip in read_character("arm.glb", made.glb()).clips] == ["bend"]


@pytest.mark.parametrize(
    ("matrices", "message"),
    [
        (np.zeros((2, 4, 4)), "matrix 0 is NaN or cannot be inverted"),
        (np.full((2, 4, 4), np.nan), "matrix 0 is NaN or cannot be inverted"),
        (np.eye(4)[None], "1 matrices for 2 joints"),
    ],
)
def test_inverse_binds_that_bind_nothing_are_refused(matrices, message):
    made = made_arm()
    made.json["skins"][0]["inverseBindMatrices"] = made.array(matrices.reshape(-1, 16), "MAT4")
    with pytest.raises(FormatError, match=message) as caught:
        read_figure("arm.glb", made.glb())
    assert caught.value.where == "/skins/0/inverseBindMatrices"


def test_a_file_that_cannot_move_is_no_character():
    with pytest.raises(FormatError, match="is not rigged"):
        read_character("t.glb", made_triangle().glb())


def test_description_counts_what_is_there():
    found = describe("arm.glb", made_arm().glb())
    assert found["clips"] == [("bend", 1.0, 2)]
    assert (len(found["mesh"].vertices), len(found["mesh"].faces), found["joints"]) == (4, 2, 2)
    assert (found["skins"], found["meshes"], found["facing"]) == ([2], 1, "+z")
    assert describe("t.glb", made_triangle().glb())["joints"] == 0


def doubled_arm(apart=0.0):
    """The arm, whose shoulder is a joint of the skin twice; its second half hangs on the twin."""
    made = made_arm()
    bind = np.tile(np.eye(4), (3, 1, 1))
    bind[1, 0, 3], bind[2, 0, 3] = -1, apart
    made.json["skins"] = []
    made.skin([1, 2, 1], bind)
    weights = made.weights(
        [[0, 2, 0, 0], [0, 1, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]],
        [[0.5, 0.5, 0, 0], [0.5, 0.5, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]],
    )
    made.json["meshes"][0]["primitives"][0]["attributes"] |= weights
    return made


def test_a_joint_that_is_there_twice_is_one(caplog):
    one = read_character("arm.glb", made_arm().glb())
    other = read_character("arm.glb", doubled_arm().glb())
    assert "1 joints are there more than once" in caplog.text
    np.testing.assert_allclose(other.skin.weights, one.skin.weights)
    np.testing.assert_allclose(
        play_clip(other, other.clips[0]), play_clip(one, one.clips[0]), atol=1e-12
    )


def test_a_joint_that_was_bound_at_two_places_is_refused():
    with pytest.raises(FormatError, match="node 1 is a joint twice, bound at two places"):
        read_character("arm.glb", doubled_arm(apart=0.5).glb())


def test_a_skin_without_one_number_among_its_weights_is_no_rig(caplog):
    made = made_arm()
    nothing = made.array(np.full((4, 4), np.nan), "VEC4")
    made.json["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"] = nothing
    assert len(read_figure("arm.glb", made.glb()).mesh.vertices) == 4  # its rig is replaced anyway
    with pytest.raises(FormatError, match="not one skinning weight is a number"):
        read_character("arm.glb", made.glb())
    made.json["meshes"][0]["primitives"] += made_arm().json["meshes"][0]["primitives"]
    assert len(read_character("arm.glb", made.glb()).mesh.vertices) == 8
    assert "follow their neighbours" in caplog.text


def test_joints_outside_the_scene_are_told(caplog):
    made = made_arm()
    made.json["scenes"][0]["nodes"] = [0]
    read_character("arm.glb", made.glb())
    assert "no joint is in the scene that shows the mesh" in caplog.text

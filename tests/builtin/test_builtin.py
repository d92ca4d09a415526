import numpy as np
import pytest

from bunraku.builtin import figure_paths, human, human_parts
from bunraku.formats import read_figure
from bunraku.meshes import connected_parts, is_closed, signed_volume, weld
from bunraku.skinning import forward_kinematics

VRM_BODY = {"hips", "spine", "chest", "upperChest", "neck", "head"} | {
    side + name
    for side in ("left", "right")
    for name in (
        *("Shoulder", "UpperArm", "LowerArm", "Hand"),
        *("UpperLeg", "LowerLeg", "Foot", "Toes"),
    )
}


def joint(name: str) -> np.ndarray:
    skeleton = human().skeleton
    world = forward_kinematics(skeleton.parents, skeleton.rest)
    return world[skeleton.names.index(name), :3, 3]


def test_human_is_one_closed_part_that_stands_on_the_ground():
    mesh = human().mesh
    assert is_closed(mesh.faces)
    assert connected_parts(mesh.faces, len(mesh.vertices)).max() == 0
    assert signed_volume(mesh.vertices, mesh.faces) > 0
    assert abs(mesh.vertices[:, 1].min()) < 1e-6
    assert 1.6 < np.ptp(mesh.vertices[:, 1]) < 1.9


def test_joints_have_vrm_names_and_frames_of_the_world():
    assert set(human().skeleton.names) == VRM_BODY
    assert np.array_equal(human().skeleton.rest[:, :3, :3], np.tile(np.eye(3), (22, 1, 1)))


def test_human_faces_forward_with_its_left_at_plus_x():
    assert joint("leftToes")[2] > joint("leftFoot")[2] + 0.1
    assert joint("leftHand")[0] > 0.3 > -0.3 > joint("rightHand")[0]
    assert joint("head")[1] > joint("hips")[1] > joint("leftFoot")[1]


def test_bind_pose_is_the_rest_pose():
    skeleton, skin = human().skeleton, human().skin
    world = forward_kinematics(skeleton.parents, skeleton.rest)
    assert np.allclose(world @ skin.inverse_bind, np.eye(4), atol=1e-12)


def test_skeleton_and_skin_are_symmetric():
    names, weights = human().skeleton.names, human().skin.weights
    for name in (n for n in names if n.startswith("left")):
        twin = name.replace("left", "right")
        assert np.allclose(joint(name) * [-1, 1, 1], joint(twin), atol=1e-6)
        sums = weights[:, [names.index(name), names.index(twin)]].sum(axis=0)
        assert sums[0] == pytest.approx(sums[1], rel=1e-5)


def test_every_vertex_has_at_most_four_influences_and_every_joint_a_vertex():
    weights = human().skin.weights
    assert (weights > 0).sum(axis=1).max() <= 4
    assert (weights.max(axis=0) > 0.3).all()


def test_parts_lie_where_their_names_say():
    labels, names = human_parts()
    vertices = human().mesh.vertices
    middle = {name: vertices[labels == i].mean(axis=0) for i, name in enumerate(names)}
    assert len(labels) == len(vertices)
    assert middle["head"][1] > middle["neck"][1] > middle["chest"][1] > middle["hips"][1]
    for part in ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot"):
        assert np.linalg.norm(middle["left" + part] - joint("left" + part)) < 0.25
        assert middle["left" + part][0] > 0 > middle["right" + part][0]


def test_loading_twice_gives_the_same_character():
    assert human() is human()


def test_stylised_figure_has_a_big_head_and_many_parts():
    figure = read_figure(figure_paths()["stylised"])
    vertices, faces, _ = weld(figure.mesh.vertices, figure.mesh.faces)
    assert 5_000 < len(figure.mesh.vertices) < 10_000
    assert connected_parts(faces, len(vertices)).max() >= 15
    assert not is_closed(faces)
    assert 1.0 < np.ptp(vertices[:, 1]) < 1.25
    widths = [
        np.ptp(vertices[np.abs(vertices[:, 1] - level) < 0.02, 0]) for level in (0.8, 0.25, 0.9)
    ]
    assert widths[0] > widths[1]  # the head is wider than both legs
    assert widths[2] > 0.3


def test_realistic_figure_is_another_body_in_another_pose():
    figure = read_figure(figure_paths()["realistic"])
    vertices, faces, _ = weld(figure.mesh.vertices, figure.mesh.faces)
    largest = np.bincount(connected_parts(faces, len(vertices))).max()
    height = np.ptp(vertices[:, 1])
    assert 5_000 < largest < 9_000  # its own triangulation: the human has 13348
    assert height < np.ptp(human().mesh.vertices[:, 1]) - 0.05
    assert np.ptp(vertices[:, 0]) < 0.45 * height  # arms down; the human's span .6 of its height
    assert len(np.unique(figure.pieces)) >= 5  # skin, hair, shirt, trousers, shoes


@pytest.mark.parametrize("name", ["stylised", "realistic"])
def test_figures_stand_on_the_ground_and_face_forward(name):
    vertices = read_figure(figure_paths()[name]).mesh.vertices
    feet = vertices[vertices[:, 1] < 0.08 * np.ptp(vertices[:, 1])]
    assert abs(vertices[:, 1].min()) < 0.01
    assert feet[:, 2].max() > 0.02 - feet[:, 2].min()  # toes reach further than heels
    assert abs(vertices[:, 0].mean()) < 0.05

import numpy as np
import pytest

from bunraku.formats.axes import check_axes, guess_up, world_from_axes
from bunraku.types import FormatError, Mesh

BOX = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
SIDES = np.array([f for a, b, c, d in QUADS for f in ((a, b, c), (a, c, d))])


def build(boxes):
    """Put boxes (centre, size) together, with points all over their sides."""
    vertices, faces = [], []
    for centre, size in boxes:
        faces.append(SIDES + 8 * len(vertices))
        vertices.append(BOX * size + centre)
    points, triangles = np.concatenate(vertices), np.concatenate(faces)
    for _ in range(3):
        corners = points[triangles]
        middle = len(points) + np.arange(len(triangles))
        points = np.concatenate([points, corners.mean(axis=1)])
        a, b, c = triangles.T
        triangles = np.concatenate(
            [np.column_stack(face) for face in ((a, b, middle), (b, c, middle), (c, a, middle))]
        )
    return Mesh(points, triangles)


@pytest.fixture
def person():
    return build(
        [
            ((0, 1.2, 0), (0.4, 0.7, 0.2)),
            ((0, 1.7, 0.02), (0.2, 0.25, 0.2)),
            ((0.1, 0.45, 0), (0.12, 0.9, 0.15)),
            ((-0.1, 0.45, 0), (0.12, 0.9, 0.15)),
            ((0.1, 0.03, 0.05), (0.1, 0.06, 0.26)),
            ((-0.1, 0.03, 0.05), (0.1, 0.06, 0.26)),
        ]
    )


@pytest.fixture
def dog():
    legs = [((x, 0.25, z), (0.1, 0.5, 0.1)) for x in (-0.15, 0.15) for z in (-0.4, 0.4)]
    return build([((0, 0.6, 0), (0.4, 0.35, 1.0)), ((0, 0.8, 0.65), (0.25, 0.25, 0.35)), *legs])


@pytest.mark.parametrize("kind", ["obj", "ply", "stl"])
@pytest.mark.parametrize("name", ["person", "dog"])
def test_figures_on_legs_are_told_upright_in_any_format(name, kind, request):
    mesh = request.getfixturevalue(name)
    assert guess_up(mesh, kind) == "y"
    lying = Mesh(mesh.vertices @ world_from_axes("z"), mesh.faces)  # the file that has z up
    assert guess_up(lying, kind) == "z"


def test_the_axis_of_symmetry_is_not_up(person):
    arms = build([((0, 1.45, 0), (2.6, 0.1, 0.1))])
    wide = Mesh(
        np.concatenate([person.vertices, arms.vertices]),
        np.concatenate([person.faces, arms.faces + len(person.vertices)]),
    )
    aside = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # left is along y, up along z
    assert guess_up(Mesh(wide.vertices @ aside.T, wide.faces), "obj") == "z"


def test_guess_stays_when_the_figure_is_moved_scaled_and_shuffled(dog, rng):
    order = rng.permutation(len(dog.faces))
    moved = Mesh(dog.vertices * 1e-4 + [3.0, -2.0, 5.0], dog.faces[order])
    assert guess_up(moved, "ply") == "y"


def test_the_format_decides_about_a_ball(rng):
    ball = rng.normal(size=(400, 3))
    cloud = Mesh(ball / np.linalg.norm(ball, axis=1)[:, None], np.empty((0, 3), np.int64))
    assert [guess_up(cloud, kind) for kind in ("obj", "stl", "ply")] == ["y", "z", "y"]


@pytest.mark.parametrize("degenerate", [np.zeros((5, 3)), np.array([[0.0, 0, 0], [0, 0, 1]])])
def test_points_and_lines_do_not_crash(degenerate):
    assert guess_up(Mesh(degenerate, np.empty((0, 3), np.int64)), "obj") in "yz"


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("facing", ["+x", "-x", "+y", "-y", "+z", "-z"])
def test_turns_bring_up_to_y_and_facing_to_z(up, facing):
    if up == facing[1]:
        with pytest.raises(FormatError, match=f"cannot face .{facing[1]} with {up} up"):
            check_axes("a.obj", up, facing)
        return
    turn = world_from_axes(up, facing)
    sign = 1.0 if facing[0] == "+" else -1.0
    np.testing.assert_array_equal(turn @ np.eye(3)["xyz".index(up)], [0, 1, 0])
    np.testing.assert_array_equal(turn @ np.eye(3)["xyz".index(facing[1])], [0, 0, sign])
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_customs_are_y_up_facing_z_and_z_up_facing_minus_y():
    np.testing.assert_array_equal(world_from_axes("y"), np.eye(3))
    np.testing.assert_array_equal(world_from_axes("z") @ [1, 2, 3], [1, 3, -2])


@pytest.mark.parametrize(("up", "facing"), [("x", None), (None, "z"), ("up", None)])
def test_axes_that_do_not_exist_are_refused(up, facing):
    with pytest.raises(FormatError, match="wanted"):
        check_axes("a.obj", up, facing)

import numpy as np
import pytest
from scipy.spatial import cKDTree
from trimesh.creation import icosphere

from bunraku.meshes import closest_points, scale_to_unit_area, vertex_areas, vertex_normals
from bunraku.registration.correspondence import Surface, features, make_surface
from bunraku.registration.nonrigid import Reach, believe, bilaplacian, pull, refine
from bunraku.rotations import vectors_to_matrices
from bunraku.spectral import laplacian

FALLING = 10.0 ** np.linspace(-5, -8.5, 8)


@pytest.fixture(scope="module")
def ball() -> Surface:
    """A sphere of area 1."""
    sphere = icosphere(subdivisions=3)
    vertices, _, _ = scale_to_unit_area(np.array(sphere.vertices), np.array(sphere.faces))
    return make_surface(vertices, np.array(sphere.faces, np.int64))


def bumped(ball: Surface, height: float = 0.03) -> Surface:
    """Raise a smooth bump on one side of the sphere."""
    toward = ball.normals @ [0.6, 0.8, 0.0]
    bump = height * np.exp(-((1 - toward) ** 2) / 0.1)
    return make_surface(ball.vertices + bump[:, None] * ball.normals, ball.faces)


def off(vertices: np.ndarray, surface: Surface) -> np.ndarray:
    return closest_points(vertices, surface.vertices, surface.faces)[2]


def test_belief_by_hand():
    """Near pairs whose normals agree; (1 + d^2 / width^2)^-2 of the distance."""
    up = np.array([0.0, 0, 1])
    tilted = np.array([0.0, np.sin(1.2), np.cos(1.2)])  # cosine .36
    distance, reach = np.array([0.0, 0.05, 0.09, 0.0]), Reach()
    belief = believe(distance, np.tile(up, (4, 1)), np.array([up, up, up, tilted]), reach)
    np.testing.assert_allclose(belief, [1.0, 0.25, 0.0, 0.0])


def test_bending_costs_a_shift_nothing_and_agrees_with_its_sum(ball, rng):
    """x^T B x = sum over vertices of (L x)^2 / area."""
    bending = bilaplacian(ball.vertices, ball.faces)
    stiffness, mass = laplacian(ball.vertices, ball.faces)
    values = rng.normal(size=len(mass))
    expected = sum((row @ values).item() ** 2 / m for row, m in zip(stiffness, mass, strict=True))
    assert np.isclose(values @ (bending @ values), expected)
    assert np.abs(bending @ np.ones(len(mass))).max() < 1e-6
    assert abs(bending - bending.T).max() < 1e-6 * abs(bending).max()


def test_a_surface_already_in_place_stays(ball):
    refined = refine(ball.vertices, ball.vertices, ball.faces, ball, stiffness=FALLING)
    np.testing.assert_allclose(refined, ball.vertices, atol=1e-9)


def test_a_smooth_bump_is_met(ball):
    goal = bumped(ball)
    refined = refine(ball.vertices, ball.vertices, ball.faces, goal, stiffness=FALLING)
    before, after = off(ball.vertices, goal), off(refined, goal)
    assert before.max() > 0.025 and after.max() < 0.002 and after.mean() < 0.1 * before.mean()
    normals = vertex_normals(refined, ball.faces)
    assert np.einsum("va,va->v", normals, ball.normals).min() > 0.6  # nothing folded over


def test_refining_moves_with_the_figure(ball):
    goal, turn = bumped(ball), vectors_to_matrices(np.array([0.4, -1.0, 0.3]))
    refined = refine(ball.vertices, ball.vertices, ball.faces, goal, stiffness=FALLING[:3])
    turned = make_surface(goal.vertices @ turn.T + 2.0, goal.faces)
    start = ball.vertices @ turn.T + 2.0
    again = refine(start, start, ball.faces, turned, stiffness=FALLING[:3])
    np.testing.assert_allclose(again, refined @ turn.T + 2.0, atol=1e-6)


def test_a_stiff_surface_only_shifts(ball):
    goal = bumped(ball)
    moved = refine(ball.vertices, ball.vertices, ball.faces, goal, stiffness=np.array([1e3]))
    shift = moved - ball.vertices
    assert np.abs(shift - shift.mean(axis=0)).max() < 0.02 * np.linalg.norm(shift.mean(axis=0))


def test_what_is_out_of_reach_or_faces_the_other_way_is_left_alone(ball):
    far = make_surface(ball.vertices + 5.0, ball.faces)
    inside_out = make_surface(bumped(ball).vertices, ball.faces[:, ::-1])
    for goal in (far, inside_out):
        refined = refine(ball.vertices, ball.vertices, ball.faces, goal, stiffness=FALLING[:2])
        np.testing.assert_allclose(refined, ball.vertices, atol=1e-6)


def test_pulls_agree_with_a_loop_over_vertices(ball):
    """Onto the tangent plane where near, at the point where far, and back from the surface."""
    goal, reach = bumped(ball), Reach()
    tree = cKDTree(features(goal.vertices, goal.normals, reach.normals))
    areas = vertex_areas(ball.vertices, ball.faces)
    wanted, weight = pull(ball.vertices, ball.faces, areas, goal, tree, reach=reach)
    place, total = np.zeros_like(wanted), np.zeros_like(weight)

    def trust(vertex: int, other: int) -> float:
        apart = np.linalg.norm(ball.vertices[vertex] - goal.vertices[other]) ** 2
        apart += reach.normals**2 * np.linalg.norm(ball.normals[vertex] - goal.normals[other]) ** 2
        agrees = ball.normals[vertex] @ goal.normals[other] > reach.agreement
        return float(agrees and apart < reach.gate**2) * (1 + apart / reach.width**2) ** -2

    moving = features(ball.vertices, ball.normals, reach.normals)
    back = cKDTree(moving).query(tree.data)[1]
    for vertex, other in enumerate(tree.query(moving)[1]):
        normal, meant = goal.normals[other], goal.vertices[other]
        slid = ball.vertices[vertex] - ((ball.vertices[vertex] - meant) @ normal) * normal
        near = np.linalg.norm(slid - meant) < reach.tangent
        place[vertex] += areas[vertex] * trust(vertex, other) * (slid if near else meant)
        total[vertex] += areas[vertex] * trust(vertex, other)
    for other, vertex in enumerate(back):
        place[vertex] += goal.areas[other] * trust(vertex, other) * goal.vertices[other]
        total[vertex] += goal.areas[other] * trust(vertex, other)
    np.testing.assert_allclose(weight, total, atol=1e-12)
    np.testing.assert_allclose(wanted, place, atol=1e-12)

import numpy as np
import pytest

from bunraku.meshes import vertex_normals
from bunraku.registration.deformation import (
    Motion,
    Wish,
    at_rest,
    build_graph,
    gauss_newton,
    turn_normals,
    warp,
)
from bunraku.rotations import vectors_to_matrices


def sheet(columns=21, rows=5, gap=()):
    """A strip two metres long in the xy plane, with columns of faces left out."""
    x, y = np.meshgrid(np.linspace(-1, 1, columns), np.linspace(-0.2, 0.2, rows))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    number = np.arange(x.size).reshape(rows, columns)
    quads = [(r, c) for r in range(rows - 1) for c in range(columns - 1) if c not in gap]
    faces = [
        face
        for r, c in quads
        for face in (
            (number[r, c], number[r, c + 1], number[r + 1, c]),
            (number[r, c + 1], number[r + 1, c + 1], number[r + 1, c]),
        )
    ]
    return vertices, np.array(faces)


def test_every_vertex_has_a_node_within_the_radius_and_weights_of_sum_one():
    vertices, faces = sheet()
    graph = build_graph(vertices, faces, 0.25)
    nearest = np.linalg.norm(vertices[:, None] - graph.nodes, axis=-1).min(axis=1)
    assert nearest.max() <= 0.25
    np.testing.assert_allclose(graph.weights.sum(axis=1), 1.0)
    assert (graph.weights >= 0).all()
    assert {(a, b) for a, b in graph.edges} == {(b, a) for a, b in graph.edges}


def test_parts_that_do_not_touch_are_bridged():
    graph = build_graph(*sheet(gap=(10,)), 0.25)
    left = graph.nodes[:, 0] < 0.05
    across = left[graph.edges[:, 0]] != left[graph.edges[:, 1]]
    assert across.sum() >= 8
    assert not (left[graph.influences].any(axis=1) & ~left[graph.influences].all(axis=1)).any()


def test_a_rigid_motion_of_all_nodes_moves_the_surface_rigidly(rng):
    vertices, faces = sheet()
    graph = build_graph(vertices, faces, 0.25)
    turn, shift = vectors_to_matrices(rng.normal(size=3)), rng.normal(size=3)
    count = len(graph.nodes)
    moved_nodes = graph.nodes @ turn.T + shift
    motion = Motion(np.tile(turn, (count, 1, 1)), moved_nodes - graph.nodes)
    moved = warp(graph, motion, vertices, slice(None))
    np.testing.assert_allclose(moved, vertices @ turn.T + shift, atol=1e-12)
    normals = vertex_normals(vertices, faces)
    turned = turn_normals(graph, motion, normals, slice(None))
    np.testing.assert_allclose(turned, normals @ turn.T, atol=1e-12)


def test_warp_is_equation_2_written_plainly(rng):
    vertices, faces = sheet()
    graph = build_graph(vertices, faces, 0.25)
    count = len(graph.nodes)
    motion = Motion(vectors_to_matrices(rng.normal(size=(count, 3))), rng.normal(size=(count, 3)))
    moved = warp(graph, motion, vertices, slice(None))
    for v in (0, 17, 60):
        plain = sum(
            w * (motion.rotations[j] @ (vertices[v] - graph.nodes[j]))
            + w * (graph.nodes[j] + motion.translations[j])
            for j, w in zip(graph.influences[v], graph.weights[v], strict=True)
        )
        np.testing.assert_allclose(moved[v], plain, atol=1e-12)


@pytest.mark.parametrize("share", [1.0, 0.1])
def test_a_surface_goes_where_all_its_points_are_wanted(share):
    vertices, faces = sheet()
    graph = build_graph(vertices, faces, 0.25)
    bent = vertices.copy()
    bend = vectors_to_matrices(np.array([0.0, -0.6, 0.0]))
    bent[vertices[:, 0] > 0] = vertices[vertices[:, 0] > 0] @ bend.T
    rows = np.arange(len(vertices))
    wish = Wish(rows, bent, vertex_normals(bent, faces), np.full(len(rows), 20.0), share)
    motion = at_rest(graph)
    for _ in range(20):
        motion = gauss_newton(graph, motion, vertices, wish, rigidity=0.1, damping=1e-6)
    off = np.linalg.norm(warp(graph, motion, vertices, slice(None)) - bent, axis=1)
    assert off.mean() < 0.01
    assert np.linalg.norm(vertices - bent, axis=1).mean() > 0.1


def test_one_step_is_the_least_squares_solution_of_the_linearised_energy(rng):
    """A slow plain version: the same energy differentiated numerically, solved densely."""
    vertices, faces = sheet(9, 3)
    graph = build_graph(vertices, faces, 0.6)
    count = len(graph.nodes)
    rows = np.array([0, 4, 8, 11, 20])
    wish = Wish(
        rows,
        vertices[rows] + 0.01 * rng.normal(size=(5, 3)),
        np.tile([0.0, 0.0, 1.0], (5, 1)),
        rng.random(5),
        0.3,
    )
    rigidity, damping = 0.7, 1e-3

    def apply(step):
        turn, shift = step.reshape(count, 2, 3).transpose(1, 0, 2)
        return Motion(vectors_to_matrices(turn), shift)

    def residuals(step):
        motion = apply(step)
        off = warp(graph, motion, vertices[rows], rows) - wish.places
        plane = np.sqrt(wish.weights) * np.einsum("pa,pa->p", wish.normals, off)
        point = np.sqrt(wish.share * wish.weights)[:, None] * off
        here, there = graph.edges.T
        arms = np.einsum(
            "eac,ec->ea", motion.rotations[here], graph.nodes[there] - graph.nodes[here]
        )
        moved = graph.nodes + motion.translations
        stretch = np.sqrt(rigidity) * (arms + moved[here] - moved[there])
        return np.concatenate([plane, point.ravel(), stretch.ravel(), np.sqrt(damping) * step])

    zero, eps = np.zeros(6 * count), 1e-6
    jacobian = np.stack(
        [(residuals(eps * e) - residuals(-eps * e)) / (2 * eps) for e in np.eye(6 * count)], axis=1
    )
    expected = apply(np.linalg.lstsq(jacobian, -residuals(zero))[0])
    found = gauss_newton(graph, at_rest(graph), vertices, wish, rigidity=rigidity, damping=damping)
    np.testing.assert_allclose(found.translations, expected.translations, atol=1e-6)
    np.testing.assert_allclose(found.rotations, expected.rotations, atol=1e-6)

import numpy as np
import pytest

from bunraku.curves import CurveSkeleton
from bunraku.registration.deformation import Motion, Wish, at_rest, gauss_newton, warp
from bunraku.registration.rings import blend_rings, build_ring_graph, ring_radii
from bunraku.rotations import rotation_angles, vectors_to_matrices


def tube(rings=21, around=10, radius=0.1):
    """A closed tube two metres long about the x axis, with three skeleton nodes a third apart."""
    x = np.linspace(-1, 1, rings)
    angle = np.arange(around) * 2 * np.pi / around
    places = np.stack(
        np.broadcast_arrays(x[:, None], radius * np.cos(angle)[None], radius * np.sin(angle)[None]),
        axis=-1,
    ).reshape(-1, 3)
    number = np.arange(rings * around).reshape(rings, around)
    here, right = number[:-1], np.roll(number[:-1], -1, axis=1)
    there, across = number[1:], np.roll(number[1:], -1, axis=1)
    faces = np.concatenate(
        [
            np.stack(t, axis=-1).reshape(-1, 3)
            for t in ((here, right, there), (right, across, there))
        ]
    )
    ends = np.array([[-1.0, 0, 0], [1.0, 0, 0]])
    first, last = len(places), len(places) + 1
    caps = [(first, number[0, (k + 1) % around], number[0, k]) for k in range(around)]
    caps += [(last, number[-1, k], number[-1, (k + 1) % around]) for k in range(around)]
    vertices = np.concatenate([places, ends])
    nodes = np.column_stack([np.linspace(-0.8, 0.8, 5), np.zeros((5, 2))])
    owners = np.abs(vertices[:, None, 0] - nodes[None, :, 0]).argmin(axis=1)
    edges = np.column_stack([np.arange(4), np.arange(1, 5)])
    return vertices, np.concatenate([faces, caps]), CurveSkeleton(nodes, edges, owners)


def test_weights_sum_to_one_and_are_the_own_ring_s_in_its_middle():
    vertices, faces, curves = tube()
    influences, weights = blend_rings(vertices, faces, curves, 0.07)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    assert (weights >= 0).all() and (influences < 5).all()
    middle = np.abs(vertices[:, 0] - curves.nodes[curves.owners, 0]) < 0.05
    own = (weights * (influences == curves.owners[:, None])).max(axis=1)
    assert own[middle].min() > 0.8
    np.testing.assert_allclose(ring_radii(vertices, curves)[2], 0.15, atol=0.05)


def test_one_ring_alone_is_a_graph_without_edges():
    vertices, faces, curves = tube()
    whole = CurveSkeleton(np.zeros((1, 3)), np.empty((0, 2), np.int64), 0 * curves.owners)
    graph = build_ring_graph(vertices, faces, whole, 0.07)
    moved = pull(graph, vertices, np.arange(len(vertices)), vertices + np.array([0.0, 0.2, 0.0]))
    found = warp(graph, moved, vertices, slice(None))
    np.testing.assert_allclose(found, vertices + np.array([0.0, 0.2, 0.0]), atol=1e-3)


def pull(graph, vertices, rows, places, steps=10):
    """Pull vertices to places, whatever their normals."""
    motion, count = at_rest(graph), len(rows)
    wish = Wish(rows, places, np.zeros((count, 3)), np.full(count, 2500 / count), 1.0)
    for _ in range(steps):
        motion = gauss_newton(graph, motion, vertices, wish, rigidity=100.0, damping=1e-3)
    return motion


def test_the_seen_half_takes_the_other_with_it_and_joints_hold():
    """The front half of a tube is pulled as if it bent by .3 radians at every joint."""
    vertices, faces, curves = tube()
    graph = build_ring_graph(vertices, faces, curves, 0.07)
    angle = 0.3 * np.arange(5)
    turns = vectors_to_matrices(angle[:, None] * np.array([[0.0, 0.0, 1.0]]))
    centres = [graph.nodes[0]]
    for before, after, pivot in zip(turns[:-1], turns[1:], graph.pivots, strict=True):
        node = len(centres)
        joint = centres[-1] + before @ (pivot - graph.nodes[node - 1])
        centres.append(joint + after @ (graph.nodes[node] - pivot))
    truth = warp(graph, Motion(turns, np.array(centres) - graph.nodes), vertices, slice(None))
    front = np.flatnonzero(vertices[:, 2] > 0.01)
    found = pull(graph, vertices, front, truth[front])
    off = np.linalg.norm(warp(graph, found, vertices, slice(None)) - truth, axis=1)
    assert np.linalg.norm(truth - vertices, axis=1).mean() > 0.2
    assert off.mean() < 0.01
    moved = graph.nodes + found.translations
    arms = np.einsum(
        "ekac,ekc->eka",
        found.rotations[graph.edges],
        graph.pivots[:, None] - graph.nodes[graph.edges],
    )
    ends = moved[graph.edges] + arms
    assert np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max() < 0.005


def test_thick_parts_bend_less():
    bent = []
    for radius in (0.05, 0.2):
        vertices, faces, curves = tube(radius=radius)
        graph = build_ring_graph(vertices, faces, curves, 0.07)
        tip = np.flatnonzero(curves.owners == 4)
        root = np.flatnonzero(curves.owners == 0)
        rows = np.concatenate([root, tip])
        places = vertices[rows] + np.where(vertices[rows, :1] > 0, [[0.0, 0.4, 0.0]], 0.0)
        wish = Wish(rows, places, np.zeros((len(rows), 3)), np.full(len(rows), 0.05), 1.0)
        motion = at_rest(graph)
        for _ in range(10):
            motion = gauss_newton(graph, motion, vertices, wish, rigidity=100.0, damping=1e-6)
        bent.append(rotation_angles(motion.rotations[4] @ motion.rotations[0].T))
    assert bent[1] < 0.5 * bent[0]
    assert graph.bends.min() == pytest.approx(graph.bends.max(), rel=0.2)

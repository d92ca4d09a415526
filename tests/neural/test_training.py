"""The network and its training; skipped where torch (extra `neural`) is not installed."""

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
pytest.importorskip("safetensors", reason="safetensors is not there: pip install bunraku[neural]")

from bunraku import builtin  # noqa: E402
from bunraku.neural.checkpoints import (  # noqa: E402
    MOMENTS,
    finished_weights,
    read_tensors,
    write_tensors,
)
from bunraku.neural.corpus import Size, build_corpus, draw_sculpted, load_corpus  # noqa: E402
from bunraku.neural.network import ShapeNetwork, encode, spread_points  # noqa: E402
from bunraku.neural.training import (  # noqa: E402
    Course,
    draw_batch,
    load_network,
    rate_at,
    train,
)
from bunraku.neural.understanding import load_reader, spread  # noqa: E402
from bunraku.types import Mesh  # noqa: E402

TINY = Size(people=0, outfits=0, sculpted=3, quadrupeds=3)
COURSE = Course(steps=4, bodies=2, points=64, warm_up=2)


@pytest.fixture(scope="module")
def corpus():
    return build_corpus(TINY, seed=0)


def run(corpus, course=COURSE, **options):
    kept = []
    reports = list(train(corpus, course, keep=kept.append, report_every=1, **options))
    return kept[-1], reports


def test_a_course_stopped_and_resumed_gives_the_same_bytes(corpus):
    whole, _ = run(corpus)
    half, reports = run(corpus, stop=lambda step: step == 2)
    assert [report.step for report in reports] == [1, 2]
    resumed, _ = run(corpus, start=half)
    assert resumed == whole
    assert run(corpus, dataclasses.replace(COURSE, seed=1))[0] != whole


def test_a_checkpoint_of_another_course_is_refused(corpus):
    stored, _ = run(corpus)
    with pytest.raises(ValueError, match="not of Course"):
        run(corpus, dataclasses.replace(COURSE, steps=9), start=stored)


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_checkpoint_without_some_of_a_parameter_s_moments_is_refused(corpus, moment):
    notes, tensors = read_tensors(run(corpus, stop=lambda step: step == 1)[0])
    lost = next(name for name in tensors if name.startswith(f"{moment}:"))
    del tensors[lost]
    with pytest.raises(ValueError, match=f"damaged.*{lost}"):
        run(corpus, start=write_tensors(tensors, notes))


def test_training_lowers_the_loss(corpus):
    course = Course(steps=40, bodies=4, points=64, warm_up=5)
    _, reports = run(corpus, course)
    losses = [report.loss for report in reports]
    assert np.mean(losses[-5:]) < 0.9 * np.mean(losses[:5])


def test_finished_weights_are_the_network_without_moments(corpus):
    stored, _ = run(corpus)
    small = finished_weights(stored)
    assert len(small) < 0.4 * len(stored)
    ours, theirs = load_network(small).state_dict(), load_network(stored).state_dict()
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)


def test_the_rate_rises_then_falls_to_nothing():
    course = Course(steps=100, warm_up=10)
    rates = [rate_at(step, course) for step in range(1, 101)]
    assert np.argmax(rates) == 9 and rates[-1] < 1e-9 and rates[4] == 0.5


def test_a_batch_is_the_same_for_the_same_step(corpus):
    first, again, other = (draw_batch(corpus, COURSE, step) for step in (1, 1, 2))
    assert torch.equal(first.points, again.points) and not torch.equal(first.points, other.points)
    assert torch.allclose(first.weights.sum(-1), torch.ones(2, 64), atol=2e-3)


def test_a_corpus_is_read_back_from_its_folder(corpus, tmp_path):
    built, read = (load_corpus(tmp_path, TINY, 0) for _ in range(2))
    assert len(list(tmp_path.iterdir())) == 1
    for name in corpus.__dataclass_fields__:
        assert np.array_equal(getattr(built, name), getattr(read, name))
        assert np.array_equal(getattr(built, name), getattr(corpus, name))


def test_joints_stay_inside_the_surface_but_for_a_nudge():
    torch.manual_seed(0)
    network, points = ShapeNetwork(), torch.rand(2, 50, 3)
    latents, parts, kinds = network.read(points, torch.zeros_like(points))
    features = network.describe(points, torch.zeros_like(points), latents)
    joints = network.locate(points, features, parts[:, 0])
    assert joints.shape == (2, 20, 3) and kinds.shape == (2, 2)
    assert joints.min() > -0.2 and joints.max() < 1.2
    assert network.weigh(features, parts[:, 1]).shape == (2, 50, 20)


def test_points_are_spread_and_waves_are_bounded():
    line = torch.linspace(0, 1, 11)[None, :, None] * torch.tensor([1.0, 0, 0])
    assert sorted(spread_points(line, 3)[0].tolist()) == [0, 5, 10]
    assert encode(line, line).shape == (1, 11, 36)


def test_values_between_known_places_are_mixed():
    known = np.array([[0.0, 0, 0], [1.0, 0, 0], [0, 50.0, 0]])
    values = np.array([[0.0], [1.0], [0.5]])
    assert np.isclose(spread(values, known, np.array([[1.0, 0, 0]]))[0, 0], 1.0, atol=1e-6)


@pytest.fixture(scope="module")
def read():
    return load_reader(builtin.shape_network())


def test_the_built_in_network_knows_people_and_quadrupeds(read):
    """Of seeds that training never used; two families that it never saw."""
    for family, least in (("rounded", 0.75), ("blocks", 0.5), ("horse", 0.7), ("hippo", 0.5)):
        right, rng = [], np.random.default_rng(999)
        for _ in range(3):
            body = draw_sculpted(family, rng)
            seen = read(body.mesh)
            assert seen.kind == body.kind
            right.append((seen.labels == body.weights.argmax(axis=1)).mean())
            assert np.allclose(seen.weights.sum(axis=1), 1.0)
        assert np.mean(right) > least, family


def test_the_built_in_network_answers_in_the_figures_own_place(read, rng):
    """A figure ten times as large and far away has the same parts, and joints that went along."""
    body = draw_sculpted("rounded", rng)
    far = Mesh(10 * body.mesh.vertices + [5.0, 0, -3], body.mesh.faces)
    near, moved = read(body.mesh), read(far)
    assert np.allclose(moved.joints, 10 * near.joints + [5.0, 0, -3], atol=1e-3)
    assert (near.labels == moved.labels).mean() > 0.99


def test_a_cloud_and_a_mirrored_surface_are_understood_too(read, rng):
    body = draw_sculpted("rounded", rng)
    seen = read(body.mesh)
    cloud = read(Mesh(body.mesh.vertices, np.zeros((0, 3), np.int64)))
    assert (cloud.labels == seen.labels).mean() > 0.7
    inside_out = read(Mesh(body.mesh.vertices, body.mesh.faces[:, ::-1].copy()))
    assert (inside_out.labels == seen.labels).mean() > 0.95

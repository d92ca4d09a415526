"""The paper's form; skipped where torch (extra `neural`) is not installed."""

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not there: pip install bunraku[neural]")
pytest.importorskip("safetensors", reason="safetensors is not there: pip install bunraku[neural]")

from bunraku import builtin  # noqa: E402
from bunraku.neural.anatomy import PERSON, QUADRUPED  # noqa: E402
from bunraku.neural.bodies import pose_body  # noqa: E402
from bunraku.neural.corpus import draw_sculpted  # noqa: E402
from bunraku.neural.implicit import adapting, form, poses, shape  # noqa: E402
from bunraku.neural.implicit import corpus as implicit_corpus  # noqa: E402
from bunraku.neural.implicit.corpus import (  # noqa: E402
    Size,
    build_implicit_corpus,
    corpus_key,
    draw_queries,
    load_implicit_corpus,
)
from bunraku.neural.implicit.offsets import Offsets, offset_loss  # noqa: E402
from bunraku.neural.implicit.training import (  # noqa: E402
    Course,
    Form,
    finished_form,
    load_form,
    train,
)
from bunraku.neural.known_poses import (  # noqa: E402
    clip_turns,
    draw_turns,
    known_turns,
    relative_turns,
    stance,
)
from bunraku.neural.parts import Understanding  # noqa: E402
from bunraku.neural.variation import chain_turns  # noqa: E402
from bunraku.types import Mesh  # noqa: E402

NONE = np.empty((0, 19, 3, 3))
TINY = Size("quadruped", labelled=3, unlabelled=2)
COURSE = Course(
    "quadruped",
    **{"pose_steps": 2, "shape_steps": 2, "offset_steps": 2},
    **{"pose_batch": 8, "shape_batch": 4, "offset_batch": 4, "points": 16},
)


@pytest.fixture(scope="module")
def corpus():
    return build_implicit_corpus(TINY, 0, builtin.human())


def run(corpus, course=COURSE, **options):
    kept = []
    reports = list(train(corpus, course, keep=kept.append, report_every=1, **options))
    return kept[-1], reports


@pytest.mark.parametrize("after", [1, 2, 3, 5])
def test_a_course_stopped_in_any_phase_and_resumed_gives_the_same_bytes(corpus, after):
    whole, reports = run(corpus)
    assert [report.step for report in reports] == [1, 2, 3, 4, 5, 6]
    part, _ = run(corpus, stop=lambda step: step == after)
    assert run(corpus, start=part)[0] == whole


def test_phases_move_what_is_theirs_alone(corpus):
    before, after = (
        load_form(run(corpus, stop=lambda step, n=n: step == n)[0]).state_dict() for n in (2, 4)
    )
    moved = {n.split(".")[0] for n in before if not torch.equal(before[n], after[n])}
    assert moved == {"shape", "codes"}


def test_another_course_is_refused(corpus):
    stored, _ = run(corpus)
    with pytest.raises(ValueError, match="not of Course"):
        run(corpus, dataclasses.replace(COURSE, inverse=0.0), start=stored)


@pytest.mark.parametrize(
    ("phase", "steps"), [("pose_steps", 60), ("shape_steps", 150), ("offset_steps", 60)]
)
def test_each_phase_lowers_its_loss(corpus, phase, steps):
    none = {"pose_steps": 0, "shape_steps": 0, "offset_steps": 0}
    course = dataclasses.replace(COURSE, **{**none, phase: steps})
    losses = [report.loss for report in run(corpus, course)[1]]
    assert np.mean(losses[-10:]) < 0.9 * np.mean(losses[:10])


def test_finished_weights_keep_the_mean_code_and_no_moments(corpus):
    stored, _ = run(corpus)
    ours, whole = load_form(finished_form(stored)), load_form(stored)
    assert len(finished_form(stored)) < 0.4 * len(stored)
    assert torch.allclose(ours.codes[0], whole.codes.mean(dim=0))
    assert torch.equal(ours.offsets.network.of_point.weight, whole.offsets.network.of_point.weight)


def test_a_corpus_is_read_back_and_knows_inside_from_outside(corpus, tmp_path):
    built, read = (load_implicit_corpus(tmp_path, TINY, 0, builtin.human()) for _ in range(2))
    for name, array in vars(corpus).items():
        assert np.array_equal(getattr(built, name), array)
        assert np.array_equal(getattr(read, name), array)
    assert 0.1 < corpus.inside.mean() < 0.6


def test_another_corpus_has_another_key(monkeypatch):
    human = builtin.human()
    fewer = dataclasses.replace(human, clips=human.clips[1:])
    people = Size(labelled=1, unlabelled=0)
    keys = {corpus_key(size, 0, who) for size in (TINY, people) for who in (human, fewer)}
    assert len(keys) == 3  # animals take no poses from clips
    for name, value in (("NOISE", 0.5), ("MARGIN", 0.5), ("FALL", 1.0), ("LABELLED_SPECIES", ())):
        monkeypatch.setattr(implicit_corpus, name, value)
        keys |= {corpus_key(size, 0, human) for size in (TINY, people)}
    assert len(keys) == 3 + 2 + 2 + 1 + 1


def test_a_box_is_occupied_inside_also_if_it_is_inside_out_or_open(cube):
    middle = (cube.vertices - cube.vertices.mean(axis=0)) / np.ptp(cube.vertices)
    for faces, least in ((cube.faces, 1.0), (cube.faces[:, ::-1], 1.0), (cube.faces[2:], 0.95)):
        points, inside = draw_queries(Mesh(middle, faces.copy()), np.random.default_rng(0))
        truth = (np.abs(points) < np.abs(middle).max(axis=0)).all(axis=1)
        assert (inside == truth).mean() >= least


def test_losses_of_shapes_by_hand():
    """Eqs. 1 to 3 against plain sums, of networks as they are drawn."""
    torch.manual_seed(0)
    network = shape.ImplicitShape(5)
    points, codes = torch.randn(2, 7, 3), torch.randn(2, shape.CODE)
    embedded = network.embed(points, codes)
    inside, labels = torch.randint(2, (2, 7)).float(), torch.randint(5, (2, 7))
    chance = network.occupied(embedded)[..., 0].sigmoid()
    plain = -(inside * chance.log() + (1 - inside) * (1 - chance).log()).mean()
    assert torch.isclose(network.occupancy_loss(embedded, inside), plain, atol=1e-6)
    parts = network.part(embedded).softmax(-1)
    picked = parts.gather(-1, labels[..., None])[..., 0]
    assert torch.isclose(network.part_loss(embedded, labels), -picked.log().mean(), atol=1e-6)
    again = torch.stack(
        [network.inverse(torch.cat([codes[b].expand(7, -1), embedded[b]], -1)) for b in range(2)]
    )
    squared = ((again - points) ** 2).sum(-1).mean()
    assert torch.isclose(network.inverse_loss(embedded, codes, points), squared, atol=1e-6)


def test_the_condition_is_put_beside_the_point():
    """One linear layer of [x, s] is the sum of one of x and one of s."""
    torch.manual_seed(0)
    network = shape.Conditioned(4, 2, width=8, layers=2)
    points, condition = torch.randn(1, 5, 3), torch.randn(1, 4)
    weight = torch.cat([network.of_point.weight, network.of_condition.weight], dim=1)
    bias = network.of_point.bias + network.of_condition.bias
    joined = torch.cat([points, condition[:, None].expand(-1, 5, -1)], dim=-1)
    assert torch.allclose(
        network(points, condition), network.rest(joined @ weight.T + bias), atol=1e-6
    )


def test_a_code_is_fitted_with_the_networks_frozen():
    torch.manual_seed(0)
    network = shape.ImplicitShape(5).requires_grad_(False)
    points = torch.rand(400, 3) - 0.5
    inside = (points.norm(dim=-1) < 0.4).float()
    queries, start = shape.Queries(points, inside, points[:50]), torch.zeros(shape.CODE)
    code = shape.fit_code(network, start, queries, inverse=0.0, steps=40, rate=1e-2)
    losses = [
        network.occupancy_loss(network.embed(points[None], c[None]), inside[None])
        for c in (start, code)
    ]
    assert losses[1] < losses[0] and not start.any()


def test_the_pose_space_turns_rigidly_and_leaves_the_root_alone():
    torch.manual_seed(0)
    space = poses.PoseSpace(20)
    turns = space.decode(torch.randn(3, poses.CODE))
    assert turns.shape == (3, 20, 3, 3)
    assert torch.allclose(turns @ turns.transpose(-1, -2), torch.eye(3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(turns), torch.ones(3, 20), atol=1e-5)
    assert torch.equal(turns[:, 0], torch.eye(3).expand(3, 3, 3))


@pytest.mark.parametrize("anatomy", [PERSON, QUADRUPED])
def test_offsets_agree_with_skinning(anatomy, rng):
    body = draw_sculpted("rounded" if anatomy is PERSON else "dog", rng)
    known = known_turns(builtin.human()) if anatomy is PERSON else NONE
    own = draw_turns(known, anatomy, 2, rng)
    world = chain_turns(anatomy, own)
    assert np.allclose(relative_turns(world, anatomy), own)
    wanted = pose_body(body, world) - body.mesh.vertices
    both = [
        torch.from_numpy(np.broadcast_to(a, (2, *a.shape)).astype(np.float32))
        for a in (body.mesh.vertices, body.weights, body.joints)
    ]
    turned = poses.chain(torch.from_numpy(own.astype(np.float32)), anatomy)
    found = poses.offsets_of(*both, turned, anatomy).numpy()
    assert np.abs(found - wanted).max() < 1e-4 and np.abs(wanted).max() > 0.05


def test_clips_of_tests_are_not_learnt_from():
    counts = [len(clip_turns(builtin.human(), kept_for_tests=kept)) for kept in (False, True)]
    assert counts == [6, 5]
    assert np.allclose(stance(np.zeros((19, 3)), QUADRUPED), np.eye(3))


def test_poses_are_told_from_arms_at_45_degrees():
    """A still human with arms raised from 45 degrees to its rest says just that turn."""
    human = builtin.human()
    still = dataclasses.replace(
        human.clips[0], rotations=human.clips[0].rotations * 0 + [0, 0, 0, 1]
    )
    own = known_turns(dataclasses.replace(human, clips=(still,)))[0]
    turned = np.degrees(np.arccos(np.clip((np.trace(own, axis1=1, axis2=2) - 1) / 2, -1, 1)))
    arms = [PERSON.index(side + "UpperArm") for side in ("left", "right")]
    assert np.allclose(np.delete(turned, arms), 0, atol=1e-3)
    assert np.ptp(turned[arms]) < 0.5 and 0 < turned[arms[0]] < 45


def test_test_time_training_keeps_lengths_and_learns_the_source(rng):
    """Its own loss falls; the volume loss keeps pairs of a part together; the given net stays."""
    torch.manual_seed(0)
    body = draw_sculpted("dog", rng)
    points = torch.from_numpy(body.mesh.vertices.astype(np.float32))
    labels = torch.from_numpy(body.weights.argmax(axis=1))
    edges = torch.from_numpy(np.stack([body.mesh.faces[:, 0], body.mesh.faces[:, 1]], axis=1))
    subject = adapting.Subject(points, edges, labels, torch.zeros(shape.CODE))
    own = chain_turns(QUADRUPED, draw_turns(NONE, QUADRUPED, 1, rng))
    moved = torch.from_numpy((pose_body(body, own) - body.mesh.vertices).astype(np.float32))
    performed = adapting.Performance(subject, moved, torch.zeros(1, poses.CODE))
    offsets = Offsets().requires_grad_(False)
    kept = {name: value.clone() for name, value in offsets.state_dict().items()}

    def off(network):
        found = network(points[None], subject.code[None], performed.pose)
        return float(offset_loss(found, moved)), found[0]

    learnt = adapting.adapt(offsets, subject, performed, steps=60)
    assert off(learnt)[0] < 0.5 * off(offsets)[0]
    assert all(torch.equal(kept[name], value) for name, value in offsets.state_dict().items())
    stiff = adapting.adapt(
        offsets, subject, performed, steps=60, losses=adapting.Losses(volume=50.0)
    )
    hips = torch.nonzero(labels == 0)[:, 0]
    pairs = torch.stack([hips, hips.flip(0)], dim=1)
    stretch = [
        adapting.length_loss(points[pairs], (points + off(n)[1])[pairs]) for n in (learnt, stiff)
    ]
    assert stretch[1] < stretch[0]


def test_lengths_are_punished_as_eq_5_says():
    before = torch.tensor([[[0.0, 0, 0], [1.0, 0, 0]], [[0.0, 0, 0], [0, 2.0, 0]]])
    after = torch.tensor([[[0.0, 0, 0], [3.0, 0, 0]], [[5.0, 0, 0], [5.0, 2.0, 0]]])
    assert torch.isclose(adapting.length_loss(before, after), torch.tensor(2.0))


def test_a_whole_turn_and_way_is_carried_rigidly(rng):
    """A pose that only turns and moves the whole needs no offsets: the network's are taken out."""
    body = draw_sculpted("dog", rng)
    seen = Understanding("quadruped", 1.0, body.weights, body.joints, 1.0)
    turn = chain_turns(QUADRUPED, np.tile(np.eye(3), (19, 1, 1)))
    turn[:] = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    posed = pose_body(body, turn[None], np.array([[0.1, 0.0, 0.3]]))
    torch.manual_seed(0)
    networks = Form("quadruped", 1).requires_grad_(False)
    known = (body.mesh, seen)
    prepared = form.prepare(networks, known, posed, known)
    assert prepared.performed.moved.abs().max() < 1e-3
    networks.offsets.network.rest[-1].weight.zero_()
    networks.offsets.network.rest[-1].bias.zero_()
    moved = form.pose_prepared(networks, prepared, body.mesh, losses=None)
    assert np.abs(moved - posed).max() < 1e-3


def test_points_and_other_kinds_are_refused(rng):
    body = draw_sculpted("dog", rng)
    seen = Understanding("person", 1.0, body.weights, body.joints, 1.0)
    networks = Form("quadruped", 1)
    with pytest.raises(ValueError, match="not points or a person"):
        form.answer(networks, (body.mesh, seen), body.mesh.vertices[None], (body.mesh, seen))

"""Train the paper's form: a course of poses, then shapes, then offsets, in one checkpoint.

    for report in train(corpus, Course(), keep=store, stop=deadline): ...

Every step draws from a generator of its own (seed, step): a stop in between changes nothing.
Rates and batches are the paper's [ZPT 4.2]; how many steps, it does not say.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32
from torch import Tensor, nn

from bunraku.neural.anatomy import ANATOMIES, Anatomy
from bunraku.neural.checkpoints import (
    Progress,
    checkpoint,
    digest,
    explaining,
    read_tensors,
    restore,
    run_steps,
    write_tensors,
)
from bunraku.neural.corpus import KINDS
from bunraku.neural.implicit import offsets, poses, shape
from bunraku.neural.implicit.corpus import ImplicitCorpus, labels_of
from bunraku.neural.known_poses import draw_turns
from bunraku.rotations import matrices_to_vectors

MOST_CODES = 100_000  # of a file that is read


@dataclass(frozen=True)
class Course:
    """What decides the result, beside the corpus."""

    kind: str = "person"
    pose_steps: int = 1000
    shape_steps: int = 3000
    offset_steps: int = 3000
    pose_batch: int = 256
    shape_batch: int = 64  # [ZPT 4.2]
    offset_batch: int = 128  # [ZPT 4.2]
    points: int = 16  # of each body a step: on the surface, and as many queries for occupancy
    inverse: float = shape.INVERSE  # 0 for the ablation without the inverse network
    seed: int = 0

    @property
    def steps(self) -> int:
        """Give the length of the whole course."""
        return self.pose_steps + self.shape_steps + self.offset_steps


class Form(nn.Module):
    """All networks of a kind, and the codes of the shapes they were trained on."""

    def __init__(self, kind: str, codes: int, *, inverse: float = shape.INVERSE) -> None:
        super().__init__()
        self.kind, self.inverse = kind, inverse
        parts = len(self.anatomy.names)
        self.space = poses.PoseSpace(parts)
        self.shape = shape.ImplicitShape(parts)
        self.offsets = offsets.Offsets()
        self.codes = nn.Parameter(0.01 * torch.randn(codes, shape.CODE))

    @property
    def anatomy(self) -> Anatomy:
        """Give the tree of the kind's parts."""
        return ANATOMIES[self.kind]


def train(
    corpus: ImplicitCorpus,
    course: Course,
    *,
    start: bytes | None = None,
    keep: Callable[[bytes], None],
    stop: Callable[[int], bool] = lambda step: False,
    report_every: int = 50,
) -> Iterator[Progress]:
    """Train to the end of the course, or until told to stop; keep checkpoints on the way.

    Args:
        start: a checkpoint to go on from; from the beginning without.
        keep: takes each checkpoint, the last one too; must store it in one step.
        stop: asked after every step, by its number.

    Yields:
        how it stands, averaged since the last report.

    Raises:
        ValueError: if the checkpoint is damaged, or of another course or corpus.
    """
    torch.set_num_threads(1)
    torch.manual_seed(course.seed)
    form = Form(course.kind, len(corpus.queries), inverse=course.inverse)
    known = _as_tensors(corpus)
    groups = [
        {"params": list(form.space.parameters()), "lr": poses.RATE},
        {"params": [*form.shape.parameters(), form.codes], "lr": shape.RATE},
        {"params": list(form.offsets.parameters()), "lr": offsets.RATE},
    ]
    optimiser = torch.optim.Adam(groups)
    origin = {"course": repr(course), "corpus": digest(vars(corpus))}
    notes = {**origin, "kind": course.kind, "inverse": repr(course.inverse)}
    first = 0 if start is None else restore(start, form, optimiser, origin)

    def learn(step: int) -> Progress:
        rng = np.random.default_rng([course.seed, step])
        torch.manual_seed(int(rng.integers(1 << 31)))
        loss, error, agreement = _ask(form, known, course, step, rng)
        optimiser.zero_grad(set_to_none=True)  # what a phase does not ask is not moved
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        return Progress(step, float(loss.detach()), float(error.detach()), agreement)

    yield from run_steps(
        range(first + 1, course.steps + 1),
        learn=learn,
        store=lambda step: checkpoint(form, optimiser, notes, step),
        keep=keep,
        stop=stop,
        report_every=report_every,
    )


@dataclass(frozen=True, eq=False)
class _Known:
    """The corpus as tensors."""

    queries: Tensor
    inside: Tensor
    surface: Tensor
    labels: Tensor
    weights: Tensor
    joints: Tensor
    stances: Tensor
    turns: Float32[np.ndarray, "known parts 3 3"]


def _as_tensors(corpus: ImplicitCorpus) -> _Known:
    return _Known(
        queries=torch.from_numpy(corpus.queries),
        inside=torch.from_numpy(corpus.inside.astype(np.float32)),
        surface=torch.from_numpy(corpus.surface),
        labels=torch.from_numpy(labels_of(corpus)),
        weights=torch.from_numpy(corpus.weights),
        joints=torch.from_numpy(corpus.joints),
        stances=torch.from_numpy(corpus.stances),
        turns=corpus.turns,
    )


def _ask(
    form: Form, known: _Known, course: Course, step: int, rng: np.random.Generator
) -> tuple[Tensor, Tensor, float]:
    """Give loss, mean distance and agreement of the phase that a step belongs to."""
    if step <= course.pose_steps:
        return _ask_poses(form, known, course, rng)
    if step <= course.pose_steps + course.shape_steps:
        return _ask_shapes(form, known, course, rng)
    return _ask_offsets(form, known, course, rng)


def _ask_poses(
    form: Form, known: _Known, course: Course, rng: np.random.Generator
) -> tuple[Tensor, Tensor, float]:
    """Encode and decode drawn poses."""
    own = draw_turns(known.turns, form.anatomy, course.pose_batch, rng)
    vectors = torch.from_numpy(matrices_to_vectors(own[:, 1:]).astype(np.float32))
    turns = torch.from_numpy(own.astype(np.float32))
    loss, error = poses.pose_loss(form.space, vectors, turns, known.joints[0], form.anatomy)
    return loss, error, float("nan")


def _ask_shapes(
    form: Form, known: _Known, course: Course, rng: np.random.Generator
) -> tuple[Tensor, Tensor, float]:
    """Ask where points of shapes are, half of them with parts (Eqs. 1 to 3)."""
    labelled, half = len(known.labels), course.shape_batch // 2
    rows = torch.from_numpy(
        np.concatenate(
            [
                rng.integers(0, labelled, half),
                rng.integers(labelled, max(len(form.codes), labelled + 1), half) % len(form.codes),
            ]
        )
    )
    near, queries, inside = _draw_points(known, rows, course.points)
    places = torch.cat([queries, near[0]], dim=1)
    codes = form.codes[rows]
    embedded = form.shape.embed(places, codes)
    on_surface = embedded[:half, course.points :]
    labels = known.labels[rows[:half]].gather(1, near[1][:half])
    loss = form.shape.occupancy_loss(embedded[:, : course.points], inside)
    loss = loss + form.shape.part_loss(on_surface, labels)
    if course.inverse:
        loss = loss + course.inverse * form.shape.inverse_loss(embedded, codes, places)
    loss = loss + shape.CODE_NORM * codes.square().sum(-1).mean()
    with torch.no_grad():
        right = (form.shape.part(on_surface).argmax(-1) == labels).float().mean()
        wrong = (form.shape.occupied(embedded[:, : course.points])[..., 0] > 0) != (inside > 0.5)
    return loss, wrong.float().mean(), float(right)


def _draw_points(
    known: _Known, rows: Tensor, count: int
) -> tuple[tuple[Tensor, Tensor], Tensor, Tensor]:
    """Draw points of surfaces (and which they are), queries, and what is known of those."""
    shapes = rows[:, None]
    chosen = torch.randint(known.surface.shape[1], (len(rows), count))
    asked = torch.randint(known.queries.shape[1], (len(rows), count))
    near = known.surface[shapes, chosen], chosen
    return near, known.queries[shapes, asked], known.inside[shapes, asked]


def _ask_offsets(
    form: Form, known: _Known, course: Course, rng: np.random.Generator
) -> tuple[Tensor, Tensor, float]:
    """Pose bodies with parts as codes say that are drawn from the pose space (Eq. 4)."""
    rows = torch.from_numpy(rng.integers(0, len(known.labels), course.offset_batch))
    codes = torch.randn(len(rows), poses.CODE)
    chosen = torch.randint(known.surface.shape[1], (len(rows), course.points))
    with torch.no_grad():
        world = poses.chain(form.space.decode(codes), form.anatomy) @ known.stances[rows]
        points, weights = (array[rows[:, None], chosen] for array in (known.surface, known.weights))
        true = poses.offsets_of(points, weights, known.joints[rows], world, form.anatomy)
    found = form.offsets(points, form.codes[rows].detach(), codes)
    distance = (found - true).square().sum(-1).sqrt().mean()
    return offsets.offset_loss(found, true), distance, float("nan")


def finished_form(stored: bytes) -> bytes:
    """Strip a checkpoint of what only training needs; of the codes their mean is left."""
    notes, tensors = read_tensors(stored)
    kept = {name: tensor for name, tensor in tensors.items() if ":" not in name}
    kept["codes"] = kept["codes"].mean(dim=0, keepdim=True)
    return write_tensors(kept, notes)


def load_form(stored: bytes) -> Form:
    """Build the networks of a file of weights or a checkpoint, ready to be asked.

    Raises:
        ValueError: if it is no such file, or is damaged.
    """
    notes, tensors = read_tensors(stored)
    with explaining():
        kind, codes = notes["kind"], tensors["codes"]
        if kind not in KINDS or not 1 <= len(codes) <= MOST_CODES:
            raise LookupError(f"{len(codes)} codes of kind {kind!r}")
        form = Form(kind, len(codes), inverse=float(notes.get("inverse", shape.INVERSE)))
        form.load_state_dict({n: t for n, t in tensors.items() if ":" not in n})
    return form.eval().requires_grad_(False)

"""Train the shape network: one seed is one result, and a stop in between changes nothing.

    for report in train(corpus, Course(), keep=store, stop=deadline): ...

Every step draws its bodies from a generator of its own (seed, step), so that a checkpoint of
weights, Adam's moments and the step's number is all there is to know.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
from safetensors.torch import load, save
from torch import Tensor
from torch.nn import functional

from bunraku.neural.anatomy import ANATOMIES
from bunraku.neural.corpus import KINDS, MOST_PARTS, Corpus, draw_variant
from bunraku.neural.network import Architecture, ShapeNetwork

KEEP_EVERY = 250  # steps
MOMENTS = ("exp_avg", "exp_avg_sq")
PART_EXISTS = torch.tensor(
    [[part < len(ANATOMIES[kind].names) for part in range(MOST_PARTS)] for kind in KINDS]
)


@dataclass(frozen=True)
class Course:
    """What decides the result, beside the corpus."""

    steps: int = 4_000
    bodies: int = 16  # a step
    points: int = 400  # of each body
    rate: float = 1.2e-3  # Adam's, after the warm-up; falls to zero along a cosine
    warm_up: int = 300
    joint_weight: float = 10.0
    seed: int = 0


@dataclass(frozen=True)
class Progress:
    """Where training stands."""

    step: int
    loss: float
    joint_error: float  # mean distance, in sizes
    agreement: float  # share of points whose strongest part is right


@dataclass(frozen=True, eq=False)
class Batch:
    """Bodies of one step, as tensors."""

    kinds: Tensor
    points: Tensor
    normals: Tensor
    weights: Tensor
    joints: Tensor


def train(
    corpus: Corpus,
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
        ValueError: if the checkpoint is of another course or network.
    """
    torch.set_num_threads(1)  # two are slower for a network this small, and less repeatable
    torch.manual_seed(course.seed)
    network = ShapeNetwork()
    optimiser = torch.optim.Adam(network.parameters(), lr=course.rate, betas=(0.9, 0.98))
    first = 0 if start is None else restore(start, network, optimiser, course)
    recent: list[Progress] = []
    step = first
    for step in range(first + 1, course.steps + 1):
        for group in optimiser.param_groups:
            group["lr"] = course.rate * rate_at(step, course)
        batch = draw_batch(corpus, course, step)
        recent.append(learn(network, optimiser, batch, step, course.joint_weight))
        last = step == course.steps or stop(step)
        if step % KEEP_EVERY == 0 or last:
            keep(checkpoint(network, optimiser, course, step))
        if step % report_every == 0 or last:
            yield _average(recent)
            recent = []
        if last:
            break


def rate_at(step: int, course: Course) -> float:
    """Give the share of the learning rate at a step: a ramp up, then a cosine down."""
    if step < course.warm_up:
        return step / course.warm_up
    done = (step - course.warm_up) / max(course.steps - course.warm_up, 1)
    return 0.5 * (1 + float(np.cos(np.pi * done)))


def draw_batch(corpus: Corpus, course: Course, step: int) -> Batch:
    """Draw the bodies of a step; some come without normals, some turned inside out."""
    rng = np.random.default_rng([course.seed, step])
    clouds = [draw_variant(corpus, course.points, rng) for _ in range(course.bodies)]
    facing = rng.choice([1.0, 0.0, -1.0], course.bodies, p=[0.82, 0.13, 0.05])
    weights = np.zeros((course.bodies, course.points, MOST_PARTS), np.float32)
    joints = np.zeros((course.bodies, MOST_PARTS, 3), np.float32)
    for row, cloud in enumerate(clouds):
        weights[row, :, : cloud.weights.shape[1]] = cloud.weights
        joints[row, : len(cloud.joints)] = cloud.joints
    points = np.stack([cloud.points for cloud in clouds]).astype(np.float32)
    normals = np.stack([cloud.normals for cloud in clouds]) * facing[:, None, None]
    return Batch(
        torch.tensor([KINDS.index(cloud.kind) for cloud in clouds]),
        *(torch.from_numpy(array) for array in (points, normals.astype(np.float32))),
        *(torch.from_numpy(array) for array in (weights, joints)),
    )


def learn(
    network: ShapeNetwork,
    optimiser: torch.optim.Optimizer,
    batch: Batch,
    step: int,
    joint_weight: float,
) -> Progress:
    """Take one step: cross entropy of skinning weights, distance of joints, and the kind."""
    latents, tokens, kinds = network.read(batch.points, batch.normals)
    parts = tokens[torch.arange(len(tokens)), batch.kinds]
    features = network.describe(batch.points, batch.normals, latents)
    exists = PART_EXISTS[batch.kinds]
    logits = network.weigh(features, parts).masked_fill(~exists[:, None], -1e4)
    entropy = -(batch.weights * logits.log_softmax(dim=-1)).sum(-1).mean()
    found = network.locate(batch.points, features, parts)
    off = ((found - batch.joints).square().sum(-1) + 1e-8).sqrt()[exists].mean()
    loss = entropy + joint_weight * off + 0.1 * functional.cross_entropy(kinds, batch.kinds)
    optimiser.zero_grad()
    loss.backward()  # type: ignore[no-untyped-call]
    torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimiser.step()
    right = (logits.argmax(-1) == batch.weights.argmax(-1)).float().mean()
    return Progress(step, float(loss.detach()), float(off.detach()), float(right))


def _average(recent: list[Progress]) -> Progress:
    mean = (float(np.mean([getattr(p, name) for p in recent])) for name in _MEASURES)
    return Progress(recent[-1].step, *mean)


_MEASURES = ("loss", "joint_error", "agreement")


def checkpoint(
    network: ShapeNetwork, optimiser: torch.optim.Optimizer, course: Course, step: int
) -> bytes:
    """Write weights, Adam's moments and the step as one safetensors file."""
    tensors = dict(network.state_dict())
    for name, parameter in network.named_parameters():
        for moment in MOMENTS:
            tensors[f"{moment}:{name}"] = optimiser.state[parameter][moment]
    notes = {"course": repr(course), "step": str(step), **network.sizes.as_strings()}
    return write_tensors(tensors, notes)


def restore(
    stored: bytes, network: ShapeNetwork, optimiser: torch.optim.Optimizer, course: Course
) -> int:
    """Take up a checkpoint; give its step."""
    notes = read_notes(stored)
    if notes.get("course") != repr(course):
        raise ValueError(
            f"the checkpoint is of {notes.get('course', 'no course')}, not of {course}; "
            "give its options again, or start anew without --resume"
        )
    tensors, step = load(stored), int(notes["step"])
    network.load_state_dict({name: tensors[name] for name in network.state_dict()})
    for name, parameter in network.named_parameters():
        moments = {moment: tensors[f"{moment}:{name}"] for moment in MOMENTS}
        optimiser.state[parameter] = {"step": torch.tensor(float(step)), **moments}
    return step


def read_step(stored: bytes) -> int:
    """Read at which step a checkpoint was taken."""
    return int(read_notes(stored)["step"])


def write_tensors(tensors: dict[str, Tensor], notes: dict[str, str]) -> bytes:
    """Write tensors and notes as safetensors: in one note, for the order of several is random."""
    written = {"notes": json.dumps(notes, sort_keys=True)}
    return save({name: tensor.contiguous() for name, tensor in tensors.items()}, written)


def read_notes(stored: bytes) -> dict[str, str]:
    """Read what is written beside the tensors."""
    size = int.from_bytes(stored[:8], "little")
    written = json.loads(stored[8 : 8 + size]).get("__metadata__", {})
    return dict(json.loads(written.get("notes", "{}")))


def finished_weights(stored: bytes) -> bytes:
    """Strip a checkpoint of what only training needs."""
    tensors = {name: tensor for name, tensor in load(stored).items() if ":" not in name}
    return write_tensors(tensors, read_notes(stored))


def load_network(stored: bytes) -> ShapeNetwork:
    """Build the network of a file of weights or a checkpoint, ready to be asked."""
    notes = read_notes(stored)
    fields = Architecture.__dataclass_fields__
    network = ShapeNetwork(Architecture(**{name: int(notes[name]) for name in fields}))
    network.load_state_dict({n: t for n, t in load(stored).items() if ":" not in n})
    return network.eval().requires_grad_(False)

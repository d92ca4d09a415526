"""Train the shape network: one seed is one result, and a stop in between changes nothing.

    for report in train(corpus, Course(), keep=store, stop=deadline): ...

Every step draws its bodies from a generator of its own (seed, step), so that a checkpoint of
weights, Adam's moments and the step's number is all there is to know.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from bunraku.neural.anatomy import ANATOMIES
from bunraku.neural.checkpoints import (
    Progress,
    checkpoint,
    digest,
    explaining,
    read_tensors,
    restore,
    run_steps,
)
from bunraku.neural.corpus import KINDS, MOST_PARTS, Corpus, draw_variant
from bunraku.neural.network import Architecture, ShapeNetwork

LARGEST = {"width": 1024, "heads": 64, "latents": 1024, "blocks": 32}  # of a network that is read
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
    begins: str = ""  # digest of the weights it begins with; drawn ones without
    weights: bytes = field(default=b"", repr=False)  # those weights


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
        ValueError: if the checkpoint is damaged, or of another course, corpus or network.
    """
    torch.set_num_threads(1)  # two are slower for a network this small, and less repeatable
    torch.manual_seed(course.seed)
    network = load_network(course.weights) if course.weights else ShapeNetwork()
    network.train().requires_grad_(True)
    optimiser = torch.optim.Adam(network.parameters(), lr=course.rate, betas=(0.9, 0.98))
    origin = {"course": repr(course), "corpus": digest(vars(corpus))}
    notes = {**origin, **network.sizes.as_strings()}
    first = 0 if start is None else restore(start, network, optimiser, origin)

    def take(step: int) -> Progress:
        for group in optimiser.param_groups:
            group["lr"] = course.rate * rate_at(step, course)
        batch = draw_batch(corpus, course, step)
        return learn(network, optimiser, batch, step, course.joint_weight)

    yield from run_steps(
        range(first + 1, course.steps + 1),
        learn=take,
        store=lambda step: checkpoint(network, optimiser, notes, step),
        keep=keep,
        stop=stop,
        report_every=report_every,
    )


def tuning_course(weights: bytes, *, steps: int | None, seed: int) -> Course:
    """Make the course of a network that has learnt already: shorter, and slower."""
    name = hashlib.sha256(weights).hexdigest()[:16]
    length = steps if steps is not None else 1_500
    warm_up = min(100, length // 8)
    return Course(
        steps=length,
        points=256,
        rate=6e-4,
        warm_up=warm_up,
        seed=seed,
        begins=name,
        weights=weights,
    )


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


def load_network(stored: bytes) -> ShapeNetwork:
    """Build the network of a file of weights or a checkpoint, ready to be asked.

    Raises:
        ValueError: if it is no such file, is damaged, or of a network that nobody would train.
    """
    notes, tensors = read_tensors(stored)
    with explaining():
        sizes = {name: int(notes[name]) for name in Architecture.__dataclass_fields__}
    if not all(1 <= sizes[name] <= most for name, most in LARGEST.items()):
        raise ValueError(f"sizes {sizes} are out of range; at most {LARGEST}")
    if sizes["width"] % sizes["heads"]:
        raise ValueError(f"a width of {sizes['width']} has not {sizes['heads']} equal heads")
    with explaining():
        network = ShapeNetwork(Architecture(**sizes))
        network.load_state_dict({n: t for n, t in tensors.items() if ":" not in n})
    return network.eval().requires_grad_(False)

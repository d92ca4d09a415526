"""Train the shape network: one seed is one result, and a stop in between changes nothing.

    for report in train(corpus, Course(), keep=store, stop=deadline): ...

Every step draws its bodies from a generator of its own (seed, step), so that a checkpoint of
weights, Adam's moments and the step's number is all there is to know.
"""

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor
from torch.nn import functional

from bunraku.neural.anatomy import ANATOMIES
from bunraku.neural.corpus import KINDS, MOST_PARTS, Corpus, draw_variant
from bunraku.neural.network import Architecture, ShapeNetwork

KEEP_EVERY = 250  # steps
LARGEST = {"width": 1024, "heads": 64, "latents": 1024, "blocks": 32}  # of a network that is read
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
        ValueError: if the checkpoint is damaged, or of another course, corpus or network.
    """
    torch.set_num_threads(1)  # two are slower for a network this small, and less repeatable
    torch.manual_seed(course.seed)
    network = ShapeNetwork()
    optimiser = torch.optim.Adam(network.parameters(), lr=course.rate, betas=(0.9, 0.98))
    origin = {"course": repr(course), "corpus": digest(corpus)}
    first = 0 if start is None else restore(start, network, optimiser, origin)
    recent: list[Progress] = []
    step = first
    for step in range(first + 1, course.steps + 1):
        for group in optimiser.param_groups:
            group["lr"] = course.rate * rate_at(step, course)
        batch = draw_batch(corpus, course, step)
        recent.append(learn(network, optimiser, batch, step, course.joint_weight))
        last = step == course.steps or stop(step)
        if step % KEEP_EVERY == 0 or last:
            keep(checkpoint(network, optimiser, origin, step))
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
    network: ShapeNetwork, optimiser: torch.optim.Optimizer, origin: dict[str, str], step: int
) -> bytes:
    """Write weights, Adam's moments, of which course and corpus they are, and the step."""
    tensors = dict(network.state_dict())
    for name, parameter in network.named_parameters():
        for moment in MOMENTS:
            tensors[f"{moment}:{name}"] = optimiser.state[parameter][moment]
    return write_tensors(tensors, {**origin, "step": str(step), **network.sizes.as_strings()})


def restore(
    stored: bytes, network: ShapeNetwork, optimiser: torch.optim.Optimizer, origin: dict[str, str]
) -> int:
    """Take up a checkpoint; give its step."""
    notes, tensors = read_tensors(stored)
    check_origin(notes, origin)
    with _explaining():
        step = int(notes["step"])
        network.load_state_dict({name: tensors[name] for name in network.state_dict()})
        for name, parameter in network.named_parameters():
            moments = {moment: tensors[f"{moment}:{name}"] for moment in MOMENTS}
            if any(moment.shape != parameter.shape for moment in moments.values()):
                raise ValueError(f"moments of {name} have another shape")
            optimiser.state[parameter] = {"step": torch.tensor(float(step)), **moments}
    return step


def check_origin(notes: dict[str, str], origin: dict[str, str]) -> None:
    """Refuse a checkpoint that another course, or another corpus, led to.

    Raises:
        ValueError: if it is of another one.
    """
    for what, wanted in origin.items():
        if notes.get(what) != wanted:
            found = notes.get(what, f"no {what}")
            raise ValueError(
                f"the checkpoint is of {found}, not of {wanted}; "
                "give its options again, or start anew without --resume"
            )


def digest(corpus: Corpus) -> str:
    """Give a name that tells a corpus from every other one, by its numbers."""
    told = hashlib.sha256()
    for name in Corpus.__dataclass_fields__:
        told.update(np.ascontiguousarray(getattr(corpus, name)).data)
    return f"corpus {told.hexdigest()[:16]}"


def read_origin(stored: bytes) -> dict[str, str]:
    """Read of which course and corpus a checkpoint is, and of which step.

    Raises:
        ValueError: if it is damaged, or no checkpoint.
    """
    notes, _ = read_tensors(stored)
    if not notes.get("step", "").isdecimal() or "course" not in notes:
        raise ValueError("it holds no checkpoint of bunraku train")
    return notes


def read_step(stored: bytes) -> int:
    """Read at which step a checkpoint was taken."""
    return int(read_origin(stored)["step"])


def write_tensors(tensors: dict[str, Tensor], notes: dict[str, str]) -> bytes:
    """Write tensors and notes as safetensors: in one note, for the order of several is random."""
    written = {"notes": json.dumps(notes, sort_keys=True)}
    return save({name: tensor.contiguous() for name, tensor in tensors.items()}, written)


def read_tensors(stored: bytes) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Read the notes and the tensors of a file that `write_tensors` made.

    Raises:
        ValueError: if it is no such file, is damaged, or a number in it is not finite.
    """
    with _explaining():
        tensors = load(stored)
        size = int.from_bytes(stored[:8], "little")
        written = json.loads(stored[8 : 8 + size]).get("__metadata__", {})
        notes = {str(name): str(note) for name, note in json.loads(written["notes"]).items()}
    for name, tensor in tensors.items():
        if tensor.dtype != torch.float32 or not tensor.isfinite().all():
            raise ValueError(f"{name} has numbers that are not finite, or of another type")
    return notes, tensors


@contextmanager
def _explaining() -> Iterator[None]:
    """Raise a ValueError whatever a damaged file leads to."""
    try:
        yield
    except (SafetensorError, LookupError, RuntimeError, TypeError, AttributeError) as error:
        raise ValueError(f"it is damaged, or no such file ({error})") from error


def finished_weights(stored: bytes) -> bytes:
    """Strip a checkpoint of what only training needs."""
    notes, tensors = read_tensors(stored)
    kept = {name: tensor for name, tensor in tensors.items() if ":" not in name}
    return write_tensors(kept, notes)


def load_network(stored: bytes) -> ShapeNetwork:
    """Build the network of a file of weights or a checkpoint, ready to be asked.

    Raises:
        ValueError: if it is no such file, is damaged, or of a network that nobody would train.
    """
    notes, tensors = read_tensors(stored)
    with _explaining():
        sizes = {name: int(notes[name]) for name in Architecture.__dataclass_fields__}
    if not all(1 <= sizes[name] <= most for name, most in LARGEST.items()):
        raise ValueError(f"sizes {sizes} are out of range; at most {LARGEST}")
    if sizes["width"] % sizes["heads"]:
        raise ValueError(f"a width of {sizes['width']} has not {sizes['heads']} equal heads")
    with _explaining():
        network = ShapeNetwork(Architecture(**sizes))
        network.load_state_dict({n: t for n, t in tensors.items() if ":" not in n})
    return network.eval().requires_grad_(False)

"""Keep networks in files: checkpoints that training goes on from, and finished weights.

stored = checkpoint(network, optimiser, notes, step)        # bytes, safetensors
step = restore(stored, network, optimiser, origin)
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor, nn

KEEP_EVERY = 250  # steps
MOMENTS = ("exp_avg", "exp_avg_sq", "step")  # of Adam


@dataclass(frozen=True)
class Progress:
    """Where training stands."""

    step: int
    loss: float
    error: float  # mean distance of joints or posed points, in sizes; or share of points misplaced
    agreement: float  # share of points whose strongest part is right; nan where parts are not asked


def run_steps(
    steps: range,
    *,
    learn: Callable[[int], Progress],
    store: Callable[[int], bytes],
    keep: Callable[[bytes], None],
    stop: Callable[[int], bool],
    report_every: int,
) -> Iterator[Progress]:
    """Take steps until the last one, or until told to stop; keep checkpoints on the way.

    Args:
        learn: takes one step, by its number.
        store: makes a checkpoint of what was learnt, by the number of the step.
        keep: takes each checkpoint, the last one too; must store it in one step.
        stop: asked after every step, by its number.

    Yields:
        how it stands, averaged since the last report.
    """
    recent: list[Progress] = []
    for step in steps:
        recent.append(learn(step))
        last = step == steps[-1] or stop(step)
        if step % KEEP_EVERY == 0 or last:
            keep(store(step))
        if step % report_every == 0 or last:
            measures = (
                float(np.mean([getattr(p, name) for p in recent]))
                for name in ("loss", "error", "agreement")
            )
            yield Progress(step, *measures)
            recent = []
        if last:
            break


def checkpoint(
    network: nn.Module, optimiser: torch.optim.Optimizer, notes: dict[str, str], step: int
) -> bytes:
    """Write weights, Adam's moments of what it moves, the step, and notes.

    Args:
        notes: of which course and corpus they are, how large the network is.
    """
    tensors = dict(network.state_dict())
    for name, parameter in network.named_parameters():
        for moment, value in optimiser.state.get(parameter, {}).items():
            tensors[f"{moment}:{name}"] = value
    return write_tensors(tensors, {**notes, "step": str(step)})


def restore(
    stored: bytes, network: nn.Module, optimiser: torch.optim.Optimizer, origin: dict[str, str]
) -> int:
    """Take up a checkpoint; give its step. Parameters without moments had not been moved yet."""
    notes, tensors = read_tensors(stored)
    check_origin(notes, origin)
    with explaining():
        step = int(notes["step"])
        network.load_state_dict({name: tensors[name] for name in network.state_dict()})
        for name, parameter in network.named_parameters():
            if not any(f"{moment}:{name}" in tensors for moment in MOMENTS):
                continue
            moments = {moment: tensors[f"{moment}:{name}"] for moment in MOMENTS}
            if any(m.shape not in (parameter.shape, torch.Size()) for m in moments.values()):
                raise ValueError(f"moments of {name} have another shape")
            optimiser.state[parameter] = moments
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
                "give its options again, or name another file with -o to start anew"
            )


def digest(arrays: Mapping[str, np.ndarray]) -> str:
    """Give a name that tells a corpus from every other one, by its numbers."""
    told = hashlib.sha256()
    for array in arrays.values():
        told.update(np.ascontiguousarray(array).data)
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
    with explaining():
        tensors = load(stored)
        size = int.from_bytes(stored[:8], "little")
        written = json.loads(stored[8 : 8 + size]).get("__metadata__", {})
        notes = {str(name): str(note) for name, note in json.loads(written["notes"]).items()}
    for name, tensor in tensors.items():
        if tensor.dtype != torch.float32 or not tensor.isfinite().all():
            raise ValueError(f"{name} has numbers that are not finite, or of another type")
    return notes, tensors


@contextmanager
def explaining() -> Iterator[None]:
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

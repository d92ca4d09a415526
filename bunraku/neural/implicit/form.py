"""The paper's form, applied: an avatar's poses on a figure, by offsets [ZPT 3].

    answers = answer(load_form(stored), (avatar, seen), poses, (figure, understood))

The paper takes pose codes from elsewhere and leaves the turn and the way of the whole body open
(digest of the paper, step 6 and gap 7). Here parts and joints of both bodies, which the caller
knows, give the turns of the avatar's parts; the pose space encodes them, and the whole turns and
moves rigidly, outside of the network.
"""

import time
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from bunraku.graphs import mesh_edges
from bunraku.neural.avatars import Poses, follow_parts
from bunraku.neural.bodies import normalise
from bunraku.neural.implicit.adapting import Losses, Performance, Subject, adapt
from bunraku.neural.implicit.corpus import draw_queries
from bunraku.neural.implicit.offsets import Offsets
from bunraku.neural.implicit.poses import encode_turns
from bunraku.neural.implicit.shape import Queries, fit_code
from bunraku.neural.implicit.training import Form
from bunraku.neural.known_poses import relative_turns, stance
from bunraku.neural.parts import Understanding, standing_height
from bunraku.types import Mesh

ROWS = {
    "paper": None,  # without test-time training
    "paper adapted": Losses(),
    "paper no volume": Losses(volume=0.0),  # the paper's ablation
}
AT_ONCE = 16_384  # points that the network is asked for together


@dataclass(frozen=True, eq=False)
class Prepared:
    """An avatar's poses and a figure as the networks see them, size 1 and without whole turns."""

    figure: Subject
    performed: Performance
    turns: Float[np.ndarray, "poses 3 3"]  # of the whole
    ways: Float[np.ndarray, "poses 3"]  # of the figure's hips, in metres
    hips: Float[np.ndarray, "3"]  # where the figure turns about, in metres
    size: float  # of the figure, in metres


@dataclass(frozen=True, eq=False)
class Answer:
    """What the paper's form makes of an avatar and a figure."""

    frames: dict[str, Poses]  # vertices of the figure, by row
    labels: Int[np.ndarray, " vertices"]  # parts of the figure's vertices
    seconds: float  # of the row "paper adapted", all poses together


def answer(
    form: Form,
    avatar: tuple[Mesh, Understanding],
    poses: Poses,
    figure: tuple[Mesh, Understanding],
) -> Answer:
    """Pose a figure with and without test-time training.

    Args:
        avatar, figure: at rest, with their parts and joints; both of the form's kind.
        poses: vertices of the avatar.

    Raises:
        ValueError: if one of them has no faces, hence no inside, or is of another kind.
    """
    for mesh, seen in (avatar, figure):
        if not len(mesh.faces) or seen.kind != form.kind:
            raise ValueError(f"wanted the surface of a {form.kind}, not points or a {seen.kind}")
    torch.set_num_threads(1)
    started = time.perf_counter()
    prepared = prepare(form, avatar, poses, figure)
    ready = time.perf_counter() - started
    frames, seconds = {}, {}
    for name, losses in ROWS.items():
        started = time.perf_counter()
        frames[name] = pose_prepared(form, prepared, figure[0], losses=losses)
        seconds[name] = ready + time.perf_counter() - started
    return Answer(frames, prepared.figure.labels.numpy(), seconds["paper adapted"])


def prepare(
    form: Form,
    avatar: tuple[Mesh, Understanding],
    poses: Poses,
    figure: tuple[Mesh, Understanding],
) -> Prepared:
    """Find the codes of both shapes and of all poses; arguments as of `answer`."""
    (mesh, seen), (other, understood) = avatar, figure
    turns, shifts = follow_parts(mesh, poses, seen)
    whole, hips = turns[:, 0], seen.joints[0]
    own = relative_turns(turns @ stance(seen.joints, seen.anatomy).swapaxes(-1, -2), seen.anatomy)
    moved = hips + (poses - (whole @ hips + shifts[:, 0])[:, None]) @ whole  # rows: turned back
    source, _, size = understand_shape(form, mesh)
    target, _, figure_size = understand_shape(form, other)
    offsets = torch.from_numpy(((moved - mesh.vertices) / size).astype(np.float32))
    scale = standing_height(other, understood.joints) / standing_height(mesh, seen.joints)
    return Prepared(
        target,
        Performance(source, offsets, encode_turns(form.space, own)),
        whole,
        scale * (whole @ hips + shifts[:, 0] - hips),
        understood.joints[0],
        figure_size,
    )


def understand_shape(form: Form, mesh: Mesh) -> tuple[Subject, Float[np.ndarray, "3"], float]:
    """Fit a code to a shape and label its points; give its middle and size, too."""
    middle, size = normalise(mesh.vertices)
    small = Mesh((mesh.vertices - middle) / size, mesh.faces)
    points, inside = draw_queries(small, np.random.default_rng(0))
    vertices = torch.from_numpy(small.vertices.astype(np.float32))
    asked = Queries(torch.from_numpy(points), torch.from_numpy(inside.astype(np.float32)), vertices)
    code = fit_code(form.shape, form.codes.mean(dim=0), asked, inverse=form.inverse)
    edges = torch.from_numpy(mesh_edges(mesh.faces))
    return Subject(vertices, edges, form.shape.label(vertices, code), code), middle, size


def pose_prepared(
    form: Form, prepared: Prepared, figure: Mesh, *, losses: Losses | None
) -> Float[np.ndarray, "poses vertices 3"]:
    """Move every vertex by its offset, then the whole; with test-time training if losses are given.

    Args:
        losses: of test-time training [ZPT 3.3]; None for none.
    """
    offsets = form.offsets
    if losses is not None:
        offsets = adapt(offsets, prepared.figure, prepared.performed, losses=losses)
    moved = [_ask(offsets, prepared.figure, pose) for pose in prepared.performed.pose]
    placed = figure.vertices + prepared.size * np.stack(moved) - prepared.hips
    turned = np.einsum("fab,fvb->fva", prepared.turns, placed)
    return turned + (prepared.hips + prepared.ways)[:, None]


@torch.no_grad()
def _ask(
    offsets: Offsets, figure: Subject, pose: Float[Tensor, " 32"]
) -> Float[np.ndarray, "vertices 3"]:
    """Give the offsets of all vertices in one pose."""
    found = [
        offsets(some[None], figure.code[None], pose[None])[0]
        for some in torch.split(figure.points, AT_ONCE)
    ]
    return torch.cat(found).double().numpy()

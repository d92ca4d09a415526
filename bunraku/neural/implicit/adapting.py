"""Test-time training: fit the offsets of one figure to its own volume and edges [ZPT 3.3]."""

import copy
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from bunraku.neural.implicit.offsets import Offsets, offset_loss

RATE = 5e-3  # Adam's [ZPT 4.2]
STEPS = 200  # for all poses together; the paper gives no number
DRAWN = 1024  # pairs, edges and points of the source a step; the paper gives no number


@dataclass(frozen=True, eq=False)
class Subject:
    """A shape to move: vertices of size 1 about its middle, its edges, parts, and code."""

    points: Float[Tensor, "points 3"]
    edges: Int[Tensor, "edges 2"]
    labels: Int[Tensor, " points"]
    code: Float[Tensor, " d"]


@dataclass(frozen=True, eq=False)
class Performance:
    """The avatar: at rest, how its points move in each pose, and the codes of the poses."""

    source: Subject
    moved: Float[Tensor, "poses points 3"]  # true offsets of its points
    pose: Float[Tensor, "poses 32"]


@dataclass(frozen=True)
class Losses:
    """Weights of the losses [ZPT 3.3]; 0 leaves one out."""

    volume: float = 0.05  # Eq. 5
    edge: float = 0.01
    source: float = 1.0  # Eq. 6


def adapt(
    offsets: Offsets,
    figure: Subject,
    performed: Performance,
    *,
    losses: Losses = Losses(),
    steps: int = STEPS,
    rate: float = RATE,
) -> Offsets:
    """Go on training the offsets for one figure and one avatar (L_T), a pose a step.

    Sums of the paper are means here: Eq. 5 has no count, so its weight would depend on how many
    pairs are drawn.

    Returns:
        a network of its own; the given one is not changed.
    """
    own = copy.deepcopy(offsets).requires_grad_(True)
    optimiser = torch.optim.Adam(own.parameters(), lr=rate)
    draw = torch.Generator().manual_seed(0)
    parts = torch.arange(int(figure.labels.max()) + 1)
    members = [torch.nonzero(figure.labels == part)[:, 0] for part in parts]
    members = [some for some in members if len(some)]
    source = performed.source
    for step in range(steps):
        frame = step % len(performed.pose)
        code = performed.pose[frame][None]
        pairs, ends = _draw_pairs(members, draw), _draw_edges(figure, draw)
        rest = figure.points[torch.cat([pairs, ends]).flatten()]
        after = rest + own(rest[None], figure.code[None], code)[0]
        before, after = rest.view(-1, 2, 3), after.view(-1, 2, 3)
        loss = losses.volume * length_loss(before[: len(pairs)], after[: len(pairs)])
        if len(ends):
            loss = loss + losses.edge * length_loss(before[len(pairs) :], after[len(pairs) :])
        some = torch.randint(len(source.points), (DRAWN,), generator=draw)
        found = own(source.points[some][None], source.code[None], code)
        loss = loss + losses.source * offset_loss(found, performed.moved[frame, some][None])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
    return own.requires_grad_(False)


def length_loss(
    before: Float[Tensor, "pairs 2 3"], after: Float[Tensor, "pairs 2 3"]
) -> Float[Tensor, ""]:
    """Punish pairs that come nearer or part: of one part's points (Eq. 5), or of edges (L_e).

    The paper cites its edge loss without defining it; we take the same form for both.
    """
    lengths = [(p[:, 0] - p[:, 1]).square().sum(-1).add(1e-12).sqrt() for p in (before, after)]
    return (lengths[0] - lengths[1]).square().mean()


def _draw_pairs(members: list[Tensor], draw: torch.Generator) -> Int[Tensor, "pairs 2"]:
    """Draw pairs of points of one part each, from parts as often as they have points."""
    total = sum(len(some) for some in members)
    pairs = []
    for some in members:
        count = max(1, round(DRAWN * len(some) / total))
        pairs.append(some[torch.randint(len(some), (count, 2), generator=draw)])
    return torch.cat(pairs)


def _draw_edges(figure: Subject, draw: torch.Generator) -> Int[Tensor, "drawn 2"]:
    if not len(figure.edges):
        return figure.edges
    return figure.edges[torch.randint(len(figure.edges), (DRAWN,), generator=draw)]

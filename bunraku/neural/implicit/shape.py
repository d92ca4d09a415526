"""Understand shapes implicitly: a code for each shape, and which part a point is of [ZPT 3.1].

    e = F([x, s]),  occupancy O(e),  parts P(e),  the point again Q([s, e])

Sizes are ours, for the paper gives none.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

CODE = 128  # d of the paper, of codes and of embeddings alike
WIDTH, LAYERS = 256, 5
INVERSE = 10.0  # weight of Eq. 3 beside Eqs. 1 and 2; the paper gives none
CODE_NORM = 1e-4
RATE = 1e-4  # Adam's, of networks and codes, in training and for new shapes [ZPT 4.2]
FIT_STEPS = 1000  # of a new shape's code
FIT_POINTS = 192  # queries a step, and as many points of the surface


class Conditioned(nn.Module):
    """An MLP of points under a condition, which enters the first layer: [x, condition]."""

    def __init__(self, condition: int, out: int, *, width: int = WIDTH, layers: int = LAYERS):
        super().__init__()
        self.of_point, self.of_condition = nn.Linear(3, width), nn.Linear(condition, width)
        hidden = [m for _ in range(layers - 1) for m in (nn.SiLU(), nn.Linear(width, width))]
        self.rest = nn.Sequential(*hidden, nn.SiLU(), nn.Linear(width, out))

    def forward(
        self, points: Float[Tensor, "b points 3"], condition: Float[Tensor, "b condition"]
    ) -> Float[Tensor, "b points out"]:
        """Answer for each point; a condition is worked out once for all of them."""
        first = self.of_point(points) + self.of_condition(condition)[:, None]
        answer: Tensor = self.rest(first)
        return answer


class ImplicitShape(nn.Module):
    """The networks F, O, P and Q."""

    def __init__(self, parts: int) -> None:
        super().__init__()
        self.embed = Conditioned(CODE, CODE)
        self.occupied = nn.Sequential(nn.SiLU(), nn.Linear(CODE, 64), nn.SiLU(), nn.Linear(64, 1))
        self.part = nn.Sequential(nn.SiLU(), nn.Linear(CODE, 64), nn.SiLU(), nn.Linear(64, parts))
        self.inverse = nn.Sequential(nn.Linear(2 * CODE, 128), nn.SiLU(), nn.Linear(128, 3))

    def occupancy_loss(
        self, embedded: Float[Tensor, "b points d"], inside: Float[Tensor, "b points"]
    ) -> Float[Tensor, ""]:
        """Compare occupancy with the truth (Eq. 1), in the mean over points."""
        return functional.binary_cross_entropy_with_logits(
            self.occupied(embedded).squeeze(-1), inside
        )

    def part_loss(
        self, embedded: Float[Tensor, "b points d"], labels: Int[Tensor, "b points"]
    ) -> Float[Tensor, ""]:
        """Compare parts of surface points with the truth (Eq. 2), in the mean over points."""
        return functional.cross_entropy(self.part(embedded).flatten(0, 1), labels.flatten())

    def inverse_loss(
        self,
        embedded: Float[Tensor, "b points d"],
        codes: Float[Tensor, "b d"],
        points: Float[Tensor, "b points 3"],
    ) -> Float[Tensor, ""]:
        """Rebuild points from codes and embeddings (Eq. 3), so that embeddings tell them apart."""
        both = torch.cat([codes[:, None].expand_as(embedded), embedded], dim=-1)
        return (self.inverse(both) - points).square().sum(-1).mean()

    @torch.no_grad()
    def label(
        self, points: Float[Tensor, "points 3"], code: Float[Tensor, " d"]
    ) -> Int[Tensor, " points"]:
        """Give the likeliest part of each point."""
        return self.part(self.embed(points[None], code[None]))[0].argmax(-1)


@dataclass(frozen=True, eq=False)
class Queries:
    """Points about one shape of size 1: which are inside, and points of its surface."""

    points: Float[Tensor, "queries 3"]
    inside: Float[Tensor, " queries"]
    surface: Float[Tensor, "surface 3"]


def fit_code(
    shape: ImplicitShape,
    start: Float[Tensor, " d"],
    queries: Queries,
    *,
    inverse: float = INVERSE,
    steps: int = FIT_STEPS,
    rate: float = RATE,
) -> Float[Tensor, " d"]:
    """Find the code of a new shape with the networks frozen: Eqs. 1 and 3, by Adam.

    Args:
        start: the code to begin with, such as the mean of all.
        queries: of the shape.
        inverse: weight of Eq. 3; 0 leaves it out, as in training without it.

    Reference:
        Wang et al. 2023, Sec. 3.1 and 4.2: the same optimiser and rate as in training.
    """
    code = start.detach().clone().requires_grad_(True)
    optimiser = torch.optim.Adam([code], lr=rate)
    draw = torch.Generator().manual_seed(0)
    for _ in range(steps):
        some = torch.randint(len(queries.points), (FIT_POINTS,), generator=draw)
        near = torch.randint(len(queries.surface), (FIT_POINTS,), generator=draw)
        places = torch.cat([queries.points[some], queries.surface[near]])[None]
        embedded = shape.embed(places, code[None])
        loss = shape.occupancy_loss(embedded[:, :FIT_POINTS], queries.inside[some][None])
        if inverse:
            loss = loss + inverse * shape.inverse_loss(embedded, code[None], places)
        loss = loss + CODE_NORM * code.square().sum()
        (code.grad,) = torch.autograd.grad(loss, [code])
        optimiser.step()
    return code.detach()

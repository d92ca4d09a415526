"""Move points of a shape, one by one, into a pose: dx = M([x, s, m]) [ZPT 3.2]."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from bunraku.neural.implicit import poses
from bunraku.neural.implicit.shape import CODE, Conditioned

RATE = 3e-4  # Adam's [ZPT 4.2]
SCALE = 0.1  # of what the network answers; ours


class Offsets(nn.Module):
    """The network M; what it answers is an offset in sizes of the body."""

    def __init__(self) -> None:
        super().__init__()
        self.network = Conditioned(CODE + poses.CODE, 3, layers=6)

    def forward(
        self,
        points: Float[Tensor, "b points 3"],
        codes: Float[Tensor, "b d"],
        pose: Float[Tensor, "b 32"],
    ) -> Float[Tensor, "b points 3"]:
        """Give the offset of each point."""
        offset: Tensor = self.network(points, torch.cat([codes, pose], dim=-1))
        return SCALE * offset


def offset_loss(
    found: Float[Tensor, "b points 3"], true: Float[Tensor, "b points 3"]
) -> Float[Tensor, ""]:
    """Compare offsets with the truth (Eq. 4), in the mean over points."""
    return (found - true).square().sum(-1).mean()

"""The shape network: from points of a surface to a skinning field and joints.

A few latent tokens read all points (cross attention), talk to one another and to a token for every
part, and any point of space may ask them which parts move it. A joint is the mean of the surface
points that vote for it, so it goes where the surface goes, however stretched.

    latents, parts = network.read(points, normals)
    logits = network.ask(points, normals, latents, parts)         # softmax: skinning weights

Paper: an auto-decoder, which fits a code to each new shape (Wang et al. 2023, Eqs. 1-3). We: an
encoder, because a code costs seconds for every figure, and says nothing of joints. Attention to
latent tokens is after Zhang et al. 2023, "3DShape2VecSet".
"""

from dataclasses import asdict, dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from bunraku.neural.corpus import KINDS, MOST_PARTS

OCTAVES = 5
_INPUTS = 6 + 6 * OCTAVES


@dataclass(frozen=True)
class Architecture:
    """Sizes of the network."""

    width: int = 128
    heads: int = 4
    latents: int = 64
    blocks: int = 3

    def as_strings(self) -> dict[str, str]:
        """Write the sizes as they are kept beside the weights."""
        return {name: str(value) for name, value in asdict(self).items()}


class Attention(nn.Module):
    """Let tokens read others, then think: one transformer block, normalised before each step."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.before = nn.LayerNorm(width)
        self.ask, self.answer = nn.Linear(width, width), nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        self.think = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, width)
        )

    def forward(self, tokens: Tensor, others: Tensor | None = None) -> Tensor:
        """Update tokens from others, or from one another."""
        read = self.before(tokens if others is None else others)
        query = self._split(self.ask(self.before(tokens)))
        key, value = (self._split(half) for half in self.answer(read).chunk(2, dim=-1))
        seen = functional.scaled_dot_product_attention(query, key, value)
        tokens = tokens + self.out(seen.transpose(1, 2).flatten(2))
        return tokens + self.think(tokens)

    def _split(self, tokens: Tensor) -> Tensor:
        return tokens.view(*tokens.shape[:2], self.heads, -1).transpose(1, 2)


class ShapeNetwork(nn.Module):
    """Understand a body: which kind, which parts move each point, where the joints are."""

    def __init__(self, sizes: Architecture | None = None) -> None:
        super().__init__()
        self.sizes = sizes = sizes or Architecture()
        width = sizes.width
        self.embed = nn.Sequential(nn.Linear(_INPUTS, width), nn.GELU(), nn.Linear(width, width))
        self.parts = nn.Parameter(torch.randn(len(KINDS) * MOST_PARTS + 1, width) * 0.02)
        self.gather = Attention(width, sizes.heads)
        self.talk = nn.ModuleList(Attention(width, sizes.heads) for _ in range(sizes.blocks))
        self.look = Attention(width, sizes.heads)
        self.feature, self.vote = nn.Linear(width, width), nn.Linear(width, width)
        self.of_part, self.for_joint = nn.Linear(width, width), nn.Linear(width, width)
        self.nudge, self.kind = nn.Linear(width, 3), nn.Linear(width, len(KINDS))

    def read(
        self, points: Float[Tensor, "bodies points 3"], normals: Float[Tensor, "bodies points 3"]
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Encode surfaces: latent tokens, a token for each part of each kind, logits of kinds."""
        embedded = self.embed(encode(points, normals))
        chosen = spread_points(points, self.sizes.latents)
        start = embedded.gather(1, chosen[..., None].expand(-1, -1, embedded.shape[-1]))
        tokens = torch.cat([start, self.parts.expand(len(points), -1, -1)], dim=1)
        tokens = self.gather(tokens, embedded)
        for block in self.talk:
            tokens = block(tokens)
        latents, parts = tokens[:, : chosen.shape[1]], tokens[:, chosen.shape[1] : -1]
        parts = parts.reshape(len(points), len(KINDS), MOST_PARTS, -1)
        return latents, parts, self.kind(tokens[:, -1])

    def describe(self, points: Tensor, normals: Tensor, latents: Tensor) -> Tensor:
        """Let points look at the latents: a feature each."""
        feature: Tensor = self.look(self.embed(encode(points, normals)), latents)
        return feature

    def weigh(
        self, features: Float[Tensor, "bodies points width"], parts: Float[Tensor, "bodies k width"]
    ) -> Float[Tensor, "bodies points k"]:
        """Give the logits of each part at each point, from features and part tokens."""
        scale = features.shape[-1] ** -0.5
        return self.feature(features) @ self.of_part(parts).transpose(1, 2) * scale

    def locate(
        self,
        points: Float[Tensor, "bodies points 3"],
        features: Float[Tensor, "bodies points width"],
        parts: Float[Tensor, "bodies k width"],
    ) -> Float[Tensor, "bodies k 3"]:
        """Give the joint of each part: the mean of the points that vote for it, nudged a little."""
        scale = features.shape[-1] ** -0.5
        votes = self.for_joint(parts) @ self.vote(features).transpose(1, 2) * scale
        return votes.softmax(dim=-1) @ points + 0.05 * self.nudge(parts)


def encode(points: Tensor, normals: Tensor) -> Tensor:
    """Write places as waves of rising frequency, beside themselves and their normals."""
    frequencies = torch.pi * 2.0 ** torch.arange(OCTAVES, dtype=points.dtype)
    phases = (points[..., None] * frequencies).flatten(-2)
    return torch.cat([points, normals, phases.sin(), phases.cos()], dim=-1)


def spread_points(points: Float[Tensor, "bodies points 3"], count: int) -> Tensor:
    """Choose points of each body one by one, each the farthest from those before."""
    chosen = torch.zeros(len(points), min(count, points.shape[1]), dtype=torch.int64)
    distance = torch.full(points.shape[:2], torch.inf)
    rows = torch.arange(len(points))
    for step in range(1, chosen.shape[1]):
        latest = points[rows, chosen[:, step - 1]]
        distance = torch.minimum(distance, (points - latest[:, None]).square().sum(-1))
        chosen[:, step] = distance.argmax(dim=1)
    return chosen

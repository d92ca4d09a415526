"""Say a pose by a code of 32 numbers [ZPT 3.2].

A variational auto-encoder after VPoser (Pavlakos et al. 2019), trained on poses that may be used:
`bunraku.neural.known_poses`.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from bunraku.neural.anatomy import Anatomy
from bunraku.rotations import matrices_to_vectors
from bunraku.types import NO_PARENT

CODE = 32  # numbers that say a pose [ZPT 3.2]
WIDTH = 512
RATE = 1e-3  # Adam's, as VPoser's
DIVERGENCE, TURNS, JOINTS = 0.005, 2.0, 2.0  # weights of the loss, as VPoser's


class PoseSpace(nn.Module):
    """Encode and decode the turns of all parts but the root, each relative to its parent."""

    def __init__(self, parts: int) -> None:
        super().__init__()
        self.moving = parts - 1
        self.encoder = nn.Sequential(
            *(nn.Linear(3 * self.moving, WIDTH), nn.LeakyReLU()),
            *(nn.Linear(WIDTH, WIDTH), nn.LeakyReLU(), nn.Linear(WIDTH, 2 * CODE)),
        )
        self.decoder = nn.Sequential(
            *(nn.Linear(CODE, WIDTH), nn.LeakyReLU()),
            *(nn.Linear(WIDTH, WIDTH), nn.LeakyReLU(), nn.Linear(WIDTH, 6 * self.moving)),
        )

    def encode(
        self, vectors: Float[Tensor, "poses moving 3"]
    ) -> tuple[Float[Tensor, "poses 32"], Float[Tensor, "poses 32"]]:
        """Give the mean and the logarithm of the variance of each pose's code."""
        mean, spread = self.encoder(vectors.flatten(1)).chunk(2, dim=-1)
        return mean, spread

    def decode(self, codes: Float[Tensor, "poses 32"]) -> Float[Tensor, "poses parts 3 3"]:
        """Give the turns that codes say; the root does not turn (its turn is no part of a code)."""
        columns = self.decoder(codes).view(len(codes), self.moving, 3, 2)
        first = functional.normalize(columns[..., 0], dim=-1)
        second = columns[..., 1] + torch.tensor([0.0, 1.0, 0.0])  # starts near the identity
        second = second - (first * second).sum(-1, keepdim=True) * first
        second = functional.normalize(second, dim=-1)
        turns = torch.stack([first, second, torch.cross(first, second, dim=-1)], dim=-1)
        root = torch.eye(3).expand(len(codes), 1, 3, 3)
        return torch.cat([root, turns], dim=1)


def pose_loss(
    space: PoseSpace,
    vectors: Float[Tensor, "poses moving 3"],
    turns: Float[Tensor, "poses parts 3 3"],
    joints: Float[Tensor, "parts 3"],
    anatomy: Anatomy,
) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
    """Compare poses with what is left of them in their codes, as VPoser does.

    VPoser also compares the vertices of a posed body; we compare joints alone, which say the same.

    Returns:
        the loss, and the mean distance of joints.
    """
    mean, spread = space.encode(vectors)
    again = space.decode(mean + (0.5 * spread).exp() * torch.randn_like(mean))
    off = [place_joints(t, joints, anatomy) for t in (again, turns)]
    distance = (off[0] - off[1]).square().sum(-1).add(1e-9).sqrt().mean()
    turned = (again - turns).square().sum((-1, -2)).mean()
    divergence = 0.5 * (mean.square() + spread.exp() - 1 - spread).sum(-1).mean()
    return DIVERGENCE * divergence + TURNS * turned + JOINTS * distance, distance.detach()


def chain(
    own: Float[Tensor, "poses parts 3 3"], anatomy: Anatomy
) -> Float[Tensor, "poses parts 3 3"]:
    """Add up turns relative to parents: turns in the world."""
    world: list[Tensor] = []
    for part, parent in enumerate(anatomy.parents):
        above = None if parent == NO_PARENT else world[parent]
        world.append(own[:, part] if above is None else above @ own[:, part])
    return torch.stack(world, dim=1)


def place_joints(
    own: Float[Tensor, "poses parts 3 3"], joints: Float[Tensor, "parts 3"], anatomy: Anatomy
) -> Float[Tensor, "poses parts 3"]:
    """Give where joints are in poses of turns relative to parents."""
    return carry_joints(chain(own, anatomy), joints.expand(len(own), -1, -1), anatomy)


def carry_joints(
    world: Float[Tensor, "poses parts 3 3"],
    joints: Float[Tensor, "poses parts 3"],
    anatomy: Anatomy,
) -> Float[Tensor, "poses parts 3"]:
    """Keep parts together at their joints: p_k = p_parent + R_parent (j_k - j_parent)."""
    places: list[Tensor] = []
    for part, parent in enumerate(anatomy.parents):
        if parent == NO_PARENT:
            places.append(joints[:, part])
            continue
        arm = (joints[:, part] - joints[:, parent])[..., None]
        places.append(places[parent] + (world[:, parent] @ arm).squeeze(-1))
    return torch.stack(places, dim=1)


def offsets_of(
    points: Float[Tensor, "poses points 3"],
    weights: Float[Tensor, "poses points parts"],
    joints: Float[Tensor, "poses parts 3"],
    world: Float[Tensor, "poses parts 3 3"],
    anatomy: Anatomy,
) -> Float[Tensor, "poses points 3"]:
    """Give how far points of known bodies move in poses of turns in the world since rest."""
    shift = carry_joints(world, joints, anatomy) - (world @ joints[..., None]).squeeze(-1)
    turned = torch.einsum("bkac,bnc->bnka", world, points) + shift[:, None]
    return torch.einsum("bnk,bnka->bna", weights, turned) - points


@torch.no_grad()
def encode_turns(
    space: PoseSpace, own: Float[np.ndarray, "poses parts 3 3"]
) -> Float[Tensor, "poses 32"]:
    """Give the codes of poses: turns relative to parents, since the human's rest."""
    vectors = torch.from_numpy(matrices_to_vectors(own[:, 1:]).astype(np.float32))
    return space.encode(vectors)[0]

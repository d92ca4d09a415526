"""A human skeleton at rest: its named joints, its own left, up and forward, its leg length."""

import logging
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bunraku.humanoids.naming import LEG, SIDES, name_joints
from bunraku.humanoids.tree import Tree
from bunraku.skinning import forward_kinematics
from bunraku.types import Skeleton

UP = np.array([0.0, 1.0, 0.0])
UPRIGHT = np.cos(np.radians(35.0))  # a trunk that leans less at rest is taken as upright
STANDING = 0.6  # cosine; nothing in a standing pose is further off than 53 degrees
BASE = ("UpperLeg", "UpperArm", "Foot")

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Body:
    """What transferring motion needs to know about a skeleton in its reference pose."""

    tree: Tree
    named: dict[str, int]
    reference: Float[np.ndarray, "joints 4 4"]  # world_from_joint, standing
    frame: Float[np.ndarray, "3 3"]  # columns: its left, up and forward, in the world
    trunk: list[int]  # hips, then every joint up to the one on which the arms hang
    neck: list[int]  # the joints from there to the head, head last; perhaps none
    leg_length: float
    stands_at_rest: bool  # else the reference is a frame of a clip

    @property
    def places(self) -> Float[np.ndarray, "joints 3"]:
        """Where the joints are in the reference pose."""
        return self.reference[:, :3, 3]


def read_body(
    skeleton: Skeleton, moved: Float[np.ndarray, "frames joints 4 4"] | None = None
) -> Body:
    """Name a skeleton's joints and measure it where it stands.

    The reference pose is the rest pose if that is a standing one. Recordings often have another
    (all bones along one axis): then the frame that comes nearest to standing takes its place.

    Args:
        skeleton: that of a human.
        moved: world_from_joint in each frame of a clip, to fall back on.

    Raises:
        MatchError: if it is not a human's.
    """
    tree, named = Tree(skeleton), name_joints(skeleton)
    top = tree.junction([named[f"{side}UpperArm"] for side in SIDES])
    inside = set(tree.below(named["hips"]))
    trunk = [named["hips"], *(joint for joint in tree.chain(top) if joint in inside)]
    above = set(tree.below(top))
    neck = [joint for joint in tree.chain(named.get("head", top)) if joint in above]
    reference = forward_kinematics(skeleton.parents, skeleton.rest)
    stands = bool(_uprightness(reference[None, :, :3, 3], named, top)[0] > STANDING)
    if moved is not None and not stands:
        best = int(_uprightness(moved[..., :3, 3], named, top).argmax())
        logger.info("the rest pose is not a standing one; frame %d is used instead", best)
        reference = moved[best]
    frame = _body_frame(reference[:, :3, 3], named, top)
    leg_length = _leg_length(tree.places, named)
    return Body(tree, named, reference, frame, trunk, neck, leg_length, stands)


def _uprightness(
    places: Float[np.ndarray, "frames joints 3"], named: dict[str, int], top: int
) -> Float[np.ndarray, " frames"]:
    """Score poses by how far they are from standing: the worst of some cosines, 1 at best.

    Legs point away from the trunk, the head away from the hips, shoulders lie along the hips, and
    the trunk points up.
    """
    left, right = (places[:, [named[f"{s}{b}"] for b in BASE]] for s in SIDES)
    middle = (left + right) / 2
    trunk = _unit(places[:, top] - middle[:, 0])
    across = _unit(left - right)
    cosines = [-(_unit(foot[:, 2] - foot[:, 0]) * trunk).sum(axis=-1) for foot in (left, right)]
    cosines += [(across[:, 0] * across[:, 1]).sum(axis=-1), 0.2 + 0.8 * trunk @ UP]
    if "head" in named:
        cosines.append((_unit(places[:, named["head"]] - places[:, top]) * trunk).sum(axis=-1))
    return np.min(cosines, axis=0)


def _unit(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Scale vectors to length 1; zero stays zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)


def _body_frame(
    places: Float[np.ndarray, "joints 3"], named: dict[str, int], top: int
) -> Float[np.ndarray, "3 3"]:
    """Find left from hip and shoulder joints, up from the trunk unless that is about upright."""
    left, right = (places[[named[f"{s}{b}"] for b in BASE[:2]]] for s in SIDES)
    across = _unit(left - right).sum(axis=0)
    up = _unit(places[top] - (left[0] + right[0]) / 2)
    up = UP if up @ UP > UPRIGHT else up
    across = _unit(across - up * (across @ up))
    return np.column_stack([across, up, np.cross(across, up)])


def _leg_length(places: Float[np.ndarray, "joints 3"], named: dict[str, int]) -> float:
    """Measure from hip joint to ankle along the bones, mean of both sides."""
    legs = [places[[named[f"{side}{role}"] for role in LEG]] for side in SIDES]
    return float(np.linalg.norm(np.diff(legs, axis=1), axis=-1).sum() / 2)

"""Keep hands out of a wide belly or a big head: swing arms outwards, no more than they need.

The world turns of a slim source, copied to a stout figure, push its hands into its body. For each
arm one constant swing about the trunk's forward axis, in all clips alike, is chosen: the least that
leaves no more of forearm and hand inside the rest of the body than the source's own, if it helps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.contacts.legs import Leg
from bunraku.contacts.planting import Frames, turn_rigidly
from bunraku.graphs import ancestors, descendants
from bunraku.humanoids.names import read_name
from bunraku.rotations import invert_rigid, vectors_to_matrices
from bunraku.skinning import linear_blend_skinning
from bunraku.types import NO_PARENT, Mesh

SWINGS = np.deg2rad([4, -4, 8, -8, 12, -12, 16, -16, 20, -20])  # tried in turn; outwards is up
TOLERATED = 0.005  # share of forearm and hand inside the body that nobody sees
WORTHWHILE = 0.4  # share of what is too much that a swing must take away
CLIPS, EACH = 8, 2  # that are looked at, and moments of each


@dataclass(frozen=True, eq=False)
class Arm:
    """An arm: its joints, which of them swing, and to which side that is outwards."""

    shoulder: int  # about which the arm swings
    trunk: int  # what the arm hangs on
    below: Int[np.ndarray, " below"]  # joints that swing: shoulder, elbow, hand, fingers
    far: Int[np.ndarray, " far"]  # of these, forearm, hand and fingers
    side: float  # 1 at the side of +X, -1 at the other


@dataclass(frozen=True, eq=False)
class Dressed:
    """A body's surface with its skin: what moves with joints."""

    mesh: Mesh
    weights: Float[np.ndarray, "vertices joints"]
    bind: Float[np.ndarray, "joints 4 4"]  # world_from_joint in the pose of the mesh


def find_arms(
    names: Sequence[str],
    joints: Float[np.ndarray, "joints 3"],
    carriers: Int[np.ndarray, " joints"],
    legs: Sequence[Leg],
) -> tuple[Arm, ...]:
    """Find arms by the names of their joints, in any of the common dialects.

    Args:
        names: of the joints.
        joints: at rest, facing +Z.
        carriers: the tree of who carries whom.
        legs: what stands on the ground is no arm.
    """
    below, arms, said = descendants(carriers), {}, [read_name(name) for name in names]
    standing = {int(joint) for leg in legs for joint in leg.end}
    for elbow, word in enumerate(said):
        above = ancestors(carriers, elbow)[1:]
        if not (word.side and word.may_be("LowerArm")) or word.side in arms:
            continue
        named = (j for j in above if said[j].side == word.side and said[j].may_be("UpperArm"))
        shoulder = next(named, NO_PARENT)
        far = np.flatnonzero(below[elbow])
        if shoulder == NO_PARENT or carriers[shoulder] == NO_PARENT or standing & set(far.tolist()):
            continue
        trunk = int(carriers[shoulder])
        aside = float(np.sign(joints[shoulder, 0] - joints[trunk, 0]))
        arms[word.side] = Arm(shoulder, trunk, np.flatnonzero(below[shoulder]), far, aside)
    return tuple(arms.values())


def swing_arm(
    frames: Frames, rest: Float[np.ndarray, "joints 4 4"], arm: Arm, angle: float
) -> Frames:
    """Swing an arm outwards about its shoulder and the forward axis of the trunk it hangs on.

    Args:
        frames: world_from_joint.
        rest: the same at rest, facing +Z.
        arm: which.
        angle: in radians.
    """
    turned = frames[:, arm.trunk, :3, :3] @ np.linalg.inv(rest[arm.trunk, :3, :3])
    ahead = turned[:, :, 2] / np.linalg.norm(turned[:, :, 2], axis=1, keepdims=True)
    turns = vectors_to_matrices(angle * arm.side * ahead)
    swung, about = frames.copy(), frames[:, arm.shoulder, :3, 3]
    turn_rigidly(swung, arm.below, turns, about, about)
    return swung


def choose_swing(
    frames: Frames,
    rest: Float[np.ndarray, "joints 4 4"],
    arm: Arm,
    bodies: tuple[Dressed, Dressed],
    source: Frames,
) -> float:
    """Choose the least swing of one arm that keeps it out of the body, as far as swings can.

    Args:
        frames: world_from_joint of the figure at some moments.
        rest: the same at rest.
        arm: which.
        bodies: the figure's surface, and the source's.
        source: world_from_joint of the source at the same moments.

    Returns:
        the angle, in radians; 0 if none is needed or none helps.
    """
    body, other = bodies
    inside = inside_share(frames, arm, body)
    if inside <= TOLERATED:
        return 0.0
    excess = inside - TOLERATED - inside_share(source, arm, other)
    best, least = 0.0, (1.0 - WORTHWHILE) * excess
    for angle in SWINGS if excess > 0 else ():
        left = inside_share(swing_arm(frames, rest, arm, angle), arm, body) - inside + excess
        if left < least:
            best, least = float(angle), left
        if left <= 0:
            break
    return best


def choose_moments(counts: Sequence[int]) -> dict[int, Int[np.ndarray, " moments"]]:
    """Choose clips, spread over all of them, and a few frames of each.

    Args:
        counts: of each clip's frames.
    """
    chosen = np.unique(np.linspace(0, len(counts) - 1, min(CLIPS, len(counts))).round())
    shares = (np.arange(EACH) + 0.5) / EACH
    return {int(k): np.unique(np.int64(shares * counts[int(k)])) for k in chosen}


def inside_share(frames: Frames, arm: Arm, body: Dressed) -> float:
    """Measure how much of forearm and hand is inside the rest of the body, over frames.

    By generalised winding numbers of the body without the arm; what is inside before it moves,
    as a sleeve is, does not count.
    """
    far = np.flatnonzero(body.weights[:, arm.far].sum(axis=1) > 0.5)
    swings = body.weights[:, arm.below].sum(axis=1) > 0.5
    faces = body.mesh.faces[~swings[body.mesh.faces].any(axis=1)]
    if not len(far) or not len(faces):
        return 0.0
    free = ~_inside(body.mesh.vertices, faces, far)
    motion = frames @ invert_rigid(body.bind)
    posed = linear_blend_skinning(body.mesh.vertices, body.weights, motion)
    return float(np.mean([(_inside(points, faces, far) & free).mean() for points in posed]))


def _inside(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    chosen: Int[np.ndarray, " chosen"],
) -> Bool[np.ndarray, " chosen"]:
    """Tell which vertices lie inside a surface, which may be open."""
    points = np.ascontiguousarray(vertices[chosen])
    winding = igl.fast_winding_number(np.ascontiguousarray(vertices), faces, points)
    return np.asarray(winding > 0.5)

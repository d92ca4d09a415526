"""From what an animator thinks of (feet on the floor, lean, gaze, arm angles) to joint rotations.

Conventions: Y up, facing +Z, left is +X. Triples of angles are (yaw, pitch, roll) in degrees about
Y, X, Z: yaw > 0 turns to the left, pitch > 0 bends forward (toes down, chin down), roll > 0 leans
to the right. Arms are given relative to the chest, everything else in the world. Since all joint
frames are aligned with the world at rest, the world rotation of a joint is its turn since the rest.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from bunraku.builtin import human
from bunraku.rotations import matrices_to_quaternions, vectors_to_matrices
from bunraku.skinning import forward_kinematics
from bunraku.types import NO_PARENT

MIRROR = np.diag([-1.0, 1.0, 1.0])
HANGING = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]).T  # bone, hinge, third
SKELETON = human().skeleton
JOINTS = {
    name: joint[:3, 3]
    for name, joint in zip(
        SKELETON.names, forward_kinematics(SKELETON.parents, SKELETON.rest), strict=True
    )
}
STANDING = JOINTS["hips"][1] + 0.012  # with the feet closer together than at rest
SIDES = ("left", "right")

Turns = Float[np.ndarray, "frames 3 3"]
Triples = Float[np.ndarray, "frames 3"]


@dataclass(frozen=True)
class Arm:
    """One arm relative to the chest, in degrees; all zero hangs straight down, palm to the thigh.

    swing: forwards; spread: outwards; twist: of the upper arm, inwards; elbow: bend; pronate: of
    the forearm, inwards; wrist: towards the palm; tilt: of the hand towards the thumb; shrug:
    collar bone upwards (added to what raising the arm does by itself); reach: forwards.
    """

    swing: Float[np.ndarray, " frames"] | float = 4.0
    spread: Float[np.ndarray, " frames"] | float = 10.0
    twist: Float[np.ndarray, " frames"] | float = 4.0
    elbow: Float[np.ndarray, " frames"] | float = 18.0
    pronate: Float[np.ndarray, " frames"] | float = 10.0
    wrist: Float[np.ndarray, " frames"] | float = 6.0
    tilt: Float[np.ndarray, " frames"] | float = 6.0
    shrug: Float[np.ndarray, " frames"] | float = 0.0
    reach: Float[np.ndarray, " frames"] | float = 0.0


@dataclass(frozen=True)
class Foot:
    """One foot in the world: where its ankle is, how it and its toes are turned, the knee's aim."""

    ankle: Triples
    turn: Triples
    toes: Float[np.ndarray, " frames"] | float = 0.0  # pitch in the world
    knee: Float[np.ndarray, " frames"] | float = 0.0  # degrees outwards from the foot's yaw


@dataclass(frozen=True)
class Posture:
    """A whole body, frame by frame."""

    hips: Triples  # position in metres
    pelvis: Triples
    chest: Triples
    head: Triples
    left_foot: Foot
    right_foot: Foot
    left_arm: Arm
    right_arm: Arm


def turns(triples: Triples) -> Turns:
    """Turn (yaw, pitch, roll) in degrees into matrices, roll first."""
    return Rotation.from_euler("YXZ", triples, degrees=True).as_matrix()


def about(axis: str, degrees: Float[np.ndarray, " frames"]) -> Turns:
    """Turn about one axis."""
    return vectors_to_matrices(np.multiply.outer(np.radians(degrees), np.eye(3)["xyz".index(axis)]))


def mirrored(matrices: Turns) -> Turns:
    """Reflect rotations in the plane between left and right."""
    return MIRROR @ matrices @ MIRROR


def between(first: Turns, second: Turns, share: float) -> Turns:
    """Go a share of the way from each rotation to another."""
    step = Rotation.from_matrix(np.swapaxes(first, -1, -2) @ second).as_rotvec()
    return first @ Rotation.from_rotvec(step * share).as_matrix()


def unit(vectors: Float[np.ndarray, "*frames 3"]) -> Float[np.ndarray, "*frames 3"]:
    """Scale vectors to length 1."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def frame(
    bone: Float[np.ndarray, "*frames 3"], hinge: Float[np.ndarray, "*frames 3"]
) -> Float[np.ndarray, "*frames 3 3"]:
    """Build a rotation of three columns: a bone's direction, its hinge made square, a third."""
    bone = unit(bone)
    hinge = unit(hinge - np.sum(hinge * bone, axis=-1, keepdims=True) * bone)
    return np.stack([bone, hinge, np.cross(bone, hinge)], axis=-1)


def rest_limb(
    names: tuple[str, str, str],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"], tuple[float, float]]:
    """Give the frames of both bones of a limb at rest, and their lengths."""
    upper, lower = JOINTS[names[1]] - JOINTS[names[0]], JOINTS[names[2]] - JOINTS[names[1]]
    hinge = np.cross(upper, lower)
    lengths = float(np.linalg.norm(upper)), float(np.linalg.norm(lower))
    return frame(upper, hinge), frame(lower, hinge), lengths


def arm_turns(chest: Turns, arm: Arm) -> dict[str, Turns]:
    """Pose the left arm: world rotations of shoulder, upper arm, lower arm and hand."""
    zero = np.zeros(len(chest))
    swing, spread, elbow = arm.swing + zero, arm.spread + zero, arm.elbow + zero
    raised = about("x", -swing) @ about("z", spread)
    height = np.degrees(np.arccos(np.clip(-(raised @ HANGING[:, 0])[:, 1], -1, 1)))
    shrug = np.clip(height - 35.0, -12.0, None) * 0.28 + arm.shrug
    shoulder = chest @ about("y", -(arm.reach + zero)) @ about("z", shrug)
    upper_rest, lower_rest, _ = rest_limb(("leftUpperArm", "leftLowerArm", "leftHand"))
    upper = chest @ raised @ about("y", -(arm.twist + zero)) @ HANGING
    lower = upper @ about("y", elbow)  # the second axis of the frame is the hinge
    pronate = arm.pronate + zero
    turn = about("x", pronate * 0.5)
    hand = lower @ about("x", pronate) @ about("y", arm.tilt + zero) @ about("z", arm.wrist + zero)
    return {
        "Shoulder": shoulder,
        "UpperArm": upper @ upper_rest.T,
        "LowerArm": lower @ turn @ lower_rest.T,
        "Hand": hand @ lower_rest.T,
    }


def leg_turns(
    socket: Triples, ankle: Triples, forward: Triples
) -> tuple[Turns, Turns, Float[np.ndarray, " frames"]]:
    """Reach for the ankle with a leg whose knee points forward (two-bone inverse kinematics).

    Returns:
        world rotations of upper and lower leg, and how much of the leg's length is used: over 1,
        the foot cannot get there.
    """
    names = ("leftUpperLeg", "leftLowerLeg", "leftFoot")
    upper_rest, lower_rest, (thigh, shin) = rest_limb(names)
    across = ankle - socket
    distance = np.linalg.norm(across, axis=-1)
    used = distance / (thigh + shin)
    distance = np.minimum(distance, 0.9999 * (thigh + shin))
    cosine = (thigh**2 + shin**2 - distance**2) / (2 * thigh * shin)
    bend = 180.0 - np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    cosine = (thigh**2 + distance**2 - shin**2) / (2 * thigh * distance)
    lead = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    straight = frame(across, np.cross(forward, across))
    upper = straight @ about("y", -lead)
    lower = upper @ about("y", bend)
    return upper @ upper_rest.T, lower @ lower_rest.T, used


def one_leg(
    posture: Posture, pelvis: Turns, side: str
) -> tuple[dict[str, Turns], Float[np.ndarray, " frames"]]:
    """Pose one leg; the right one as the mirror image of a left one."""
    foot: Foot = getattr(posture, f"{side}_foot")
    sign = 1.0 if side == "left" else -1.0
    socket = posture.hips + pelvis @ (JOINTS[f"{side}UpperLeg"] - JOINTS["hips"])
    yaw = np.radians(foot.turn[:, 0] + sign * foot.knee)
    forward = np.stack([np.sin(yaw), np.zeros(len(yaw)), np.cos(yaw)], axis=-1)
    flip = np.eye(3) if side == "left" else MIRROR
    upper, lower, used = leg_turns(socket @ flip, foot.ankle @ flip, forward @ flip)
    if side == "right":
        upper, lower = mirrored(upper), mirrored(lower)
    toes = foot.turn.copy()
    toes[:, 1], toes[:, 2] = foot.toes, 0.0
    answer = {"UpperLeg": upper, "LowerLeg": lower, "Foot": turns(foot.turn), "Toes": turns(toes)}
    return {side + name: turn for name, turn in answer.items()}, used


def world_turns(posture: Posture) -> tuple[dict[str, Turns], Float[np.ndarray, "frames 2"]]:
    """Give the world rotation of every joint, and how much of each leg's length is used."""
    pelvis, chest, head = (turns(t) for t in (posture.pelvis, posture.chest, posture.head))
    answer = {"hips": pelvis, "upperChest": chest, "head": head}
    answer["spine"] = between(pelvis, chest, 0.35)
    answer["chest"] = between(pelvis, chest, 0.75)
    answer["neck"] = between(chest, head, 0.45)
    left = arm_turns(chest, posture.left_arm)
    right = arm_turns(mirrored(chest), posture.right_arm)
    answer |= {"left" + name: turn for name, turn in left.items()}
    answer |= {"right" + name: mirrored(turn) for name, turn in right.items()}
    used = []
    for side in SIDES:
        leg, share = one_leg(posture, pelvis, side)
        answer |= leg
        used.append(share)
    return answer, np.stack(used, axis=-1)


def settle(posture: Posture, limit: float = 0.993, *, loop: bool = False) -> Posture:
    """Lower the hips where a leg would be stretched over a share of its length, and smoothly.

    Args:
        posture: a body whose feet may be out of reach.
        limit: how much of a leg's length may be used; 1 is a locked knee.
        loop: whether the last frame goes on in the first.
    """
    frames = len(posture.hips)
    low, high = np.full(frames, 0.4), np.zeros(frames)
    for _ in range(20):
        middle = (low + high) / 2
        reached = (world_turns(lifted(posture, -middle))[1] <= limit).all(axis=1)
        low, high = np.where(reached, middle, low), np.where(reached, high, middle)
    drop = low[:-1] if loop else low
    mode = "wrap" if loop else "nearest"
    smooth = gaussian_filter1d(maximum_filter1d(drop, 9, mode=mode), 2.0, mode=mode, radius=4)
    return lifted(posture, -(np.append(smooth, smooth[0]) if loop else smooth))


def lifted(posture: Posture, height: float | Float[np.ndarray, " frames"]) -> Posture:
    """Lift the hips and leave the feet where they are."""
    hips = posture.hips + np.multiply.outer(np.asarray(height), [0.0, 1.0, 0.0])
    return Posture(**{**vars(posture), "hips": hips})


def clip_arrays(posture: Posture) -> dict[str, Float[np.ndarray, "frames ..."]]:
    """Turn a posture into what is stored: the hips' path and every joint's local quaternion."""
    world, used = world_turns(posture)
    assert used.max() < 1.0, f"a foot is out of reach: {used.max():.3f} of the leg"
    rotations = np.stack([world[name] for name in SKELETON.names], axis=1)
    local = rotations.copy()
    child = SKELETON.parents != NO_PARENT
    parent = np.swapaxes(rotations[:, SKELETON.parents[child]], -1, -2)
    local[:, child] = parent @ rotations[:, child]
    return {"hips": posture.hips, "rotations": continuous(matrices_to_quaternions(local))}


def continuous(
    quaternions: Float[np.ndarray, "frames joints 4"],
) -> Float[np.ndarray, "frames joints 4"]:
    """Choose signs so that each quaternion is near the one before it."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=-1) < 0
    signs = np.where(np.cumsum(flips, axis=0) % 2, -1.0, 1.0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs[..., None]])

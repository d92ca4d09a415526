"""Endless variants of known bodies: other proportions, rest poses, sizes and headings.

Weights and labels stay valid: parts are scaled and turned by the motion that skinning blends.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from bunraku.neural.anatomy import ANATOMIES, Anatomy
from bunraku.neural.bodies import Body, Cloud, normalise, pose_motion
from bunraku.rotations import rotation_between, vectors_to_matrices
from bunraku.skinning import linear_blend_skinning
from bunraku.types import NO_PARENT, Mesh

# ranges of scale along and across: notes of the prototypes, a little wider
_ALONG = {"head": (0.7, 2.6), "Arm": (0.55, 1.3), "Leg": (0.35, 1.2), "Hand": (0.7, 2.0)}
_ACROSS = {"head": (0.8, 2.8), "Arm": (0.7, 1.9), "Leg": (0.7, 1.8), "Hand": (0.7, 2.0)}
_ALONG |= {"Foot": (0.7, 1.9), "neck": (0.3, 1.6), "trunk": (0.65, 1.3), "tail": (0.5, 1.6)}
_ACROSS |= {"Foot": (0.7, 1.9), "neck": (0.7, 1.6), "trunk": (0.7, 1.75), "tail": (0.5, 1.8)}


def vary(cloud: Cloud, rng: np.random.Generator, *, stylise: float = 0.7) -> Cloud:
    """Draw a variant of a body: proportions, rest pose, size along the axes, heading, side.

    Args:
        stylise: how often proportions change.
    """
    anatomy = ANATOMIES[cloud.kind]
    maps = np.tile(np.eye(3), (len(anatomy.names), 1, 1))
    if rng.random() < stylise:
        maps = scale_parts(cloud.joints, anatomy, rng)
    turns = rest_turns(cloud.joints, anatomy, rng)
    return finish_variant(apply_maps(cloud, turns @ maps), rng)


def scale_parts(
    joints: Float[np.ndarray, "parts 3"], anatomy: Anatomy, rng: np.random.Generator
) -> Float[np.ndarray, "parts 3 3"]:
    """Draw how each part is scaled along and across its axis; twins alike."""
    maps = np.empty((len(joints), 3, 3))
    strength = float(rng.uniform(0.3, 1.0))
    drawn: dict[str, tuple[float, float]] = {}
    for part, name in enumerate(anatomy.names):
        key = _region(name)
        if key not in drawn:
            along, across = (
                float(np.exp(strength * rng.uniform(*np.log(ranges[key]))))
                for ranges in (_ALONG, _ACROSS)
            )
            drawn[key] = along, across
        along, across = drawn[key]
        axis = part_axis(joints, anatomy, part)
        outer = np.outer(axis, axis)
        maps[part] = along * outer + across * (np.eye(3) - outer)
    return maps


def _region(name: str) -> str:
    """Give the key of the ranges above: limbs by the end of their name."""
    for key in ("Foot", "Hand", "Arm", "Leg", "head", "neck", "tail"):
        if key in name:
            return key
    return "trunk"


def part_axis(
    joints: Float[np.ndarray, "parts 3"], anatomy: Anatomy, part: int
) -> Float[np.ndarray, "3"]:
    """Give the direction of a part: to the next joint, or at a tip, on from the one before."""
    after, before = anatomy.children[part], anatomy.parents[part]
    name = anatomy.names[part]
    if name == "head" or (after == NO_PARENT and before == NO_PARENT):
        return np.array([0.0, 1.0, 0.0])
    if name.endswith("Foot") and anatomy.kind == "person":
        return np.array([0.0, 0.0, 1.0])
    bone = joints[after] - joints[part] if after != NO_PARENT else joints[part] - joints[before]
    length = float(np.linalg.norm(bone))
    return bone / length if length > 1e-6 else np.array([0.0, 1.0, 0.0])


def rest_turns(
    joints: Float[np.ndarray, "parts 3"], anatomy: Anatomy, rng: np.random.Generator
) -> Float[np.ndarray, "parts 3 3"]:
    """Draw a rest pose: people's arms from a T to hanging, every joint a little off."""
    wild = rng.random() < 0.25
    own = vectors_to_matrices(rng.normal(0, 0.25 if wild else 0.05, (len(joints), 3)))
    if anatomy.kind == "person":
        fall = float(rng.choice([0.0, 45.0, 78.0])) + float(rng.normal(0, 8))
        spread = np.radians(float(rng.normal(4, 5)))
        stance = arm_turns(joints, anatomy, fall)
        for side, sign in (("left", 1.0), ("right", -1.0)):
            turn = vectors_to_matrices(np.array([0.0, 0.0, sign * spread]))
            stance[anatomy.index(f"{side}UpperLeg")] = turn
        return chain_turns(anatomy, stance @ own)
    return chain_turns(anatomy, own)


def arm_turns(
    joints: Float[np.ndarray, "parts 3"], anatomy: Anatomy, fall: float
) -> Float[np.ndarray, "parts 3 3"]:
    """Turn a person's upper arms so that they point so many degrees below the horizontal."""
    turns = np.tile(np.eye(3), (len(joints), 1, 1))
    down = np.radians(np.clip(fall, -20, 88))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        upper, hand = anatomy.index(f"{side}UpperArm"), anatomy.index(f"{side}Hand")
        bone = joints[hand] - joints[upper]
        wanted = np.array([sign * np.cos(down), -np.sin(down), 0.0])
        turns[upper] = rotation_between(bone, wanted)
    return turns


def chain_turns(
    anatomy: Anatomy, own: Float[np.ndarray, "*frames parts 3 3"]
) -> Float[np.ndarray, "*frames parts 3 3"]:
    """Add up turns of parts relative to their parents, in world axes at rest."""
    turns = own.copy()
    for part, parent in enumerate(anatomy.parents):
        if parent != NO_PARENT:
            turns[..., part, :, :] = turns[..., parent, :, :] @ own[..., part, :, :]
    return turns


def apply_maps(cloud: Cloud, maps: Float[np.ndarray, "parts 3 3"]) -> Cloud:
    """Move a cloud by linear maps of its parts: points, normals and joints."""
    anatomy = ANATOMIES[cloud.kind]
    motion = pose_motion(cloud.joints, anatomy.parents, maps)
    upright = np.linalg.inv(maps).swapaxes(-1, -2)
    blended = (cloud.weights @ upright.reshape(len(upright), 9)).reshape(-1, 3, 3)
    moved = np.einsum("kab,kb->ka", motion[:, :3, :3], cloud.joints) + motion[:, :3, 3]
    return replace(
        cloud,
        points=linear_blend_skinning(cloud.points, cloud.weights, motion),
        normals=np.einsum("pab,pb->pa", blended, cloud.normals),
        joints=moved,
    )


def finish_variant(cloud: Cloud, rng: np.random.Generator) -> Cloud:
    """Stretch a cloud along the axes, turn it a little, mirror it or not; bumps; to size 1."""
    stretch = np.exp(rng.uniform(-0.2, 0.2, 3))
    heading = vectors_to_matrices(np.array([0.0, float(rng.normal(0, 0.12)), 0.0]))
    linear = heading * stretch
    inverse = np.linalg.inv(linear)
    weights = cloud.weights
    if rng.random() < 0.5:
        linear, inverse = linear * [-1.0, 1.0, 1.0], inverse * [[-1.0], [1.0], [1.0]]
        twins = ANATOMIES[cloud.kind].twins
        weights, joints = weights[:, twins], cloud.joints[twins]
    else:
        joints = cloud.joints
    points, joints = cloud.points @ linear.T, joints @ linear.T
    normals = cloud.normals @ inverse
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    middle, size = normalise(points)
    points, joints = (points - middle) / size, (joints - middle) / size
    waves = rng.normal(0, 6, (3, 4)), rng.uniform(0, 2 * np.pi, 4), rng.normal(0, 0.005, (4, 3))
    points = points + np.sin(points @ waves[0] + waves[1]) @ waves[2]
    return replace(cloud, points=points, normals=normals, weights=weights, joints=joints)


def vary_body(body: Body, maps: Float[np.ndarray, "parts 3 3"]) -> Body:
    """Move a whole body, mesh and joints, by linear maps of its parts, and bring it to size 1."""
    motion = pose_motion(body.joints, body.anatomy.parents, maps)
    vertices = linear_blend_skinning(body.mesh.vertices, body.weights, motion)
    moved = np.einsum("kab,kb->ka", motion[:, :3, :3], body.joints) + motion[:, :3, 3]
    middle, size = normalise(vertices)
    return replace(
        body, mesh=Mesh((vertices - middle) / size, body.mesh.faces), joints=(moved - middle) / size
    )

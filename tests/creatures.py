"""A tiny rigged creature made from capsules: the smallest character that all of bunraku works on.

It stands 1.1 m high, faces +Z, and has a snout, feet and a tail, so that front and back differ;
left and right are mirror images. Its surface and its skin are both formulas, so a copy with other
triangles comes with its true skin.
"""

import numpy as np
from scipy.spatial.transform import Rotation
from skimage.measure import marching_cubes

from bunraku.rotations import compose_transforms, matrices_to_quaternions, vectors_to_matrices
from bunraku.skinning import (
    forward_kinematics,
    keep_influences,
    linear_blend_skinning,
    local_transforms,
    pose_joints,
)
from bunraku.types import Character, Clip, Mesh, Skeleton, Skin

NAMES = ("hips", "chest", "head", "leftArm", "rightArm", "leftLeg", "rightLeg")
PARENTS = np.array([-1, 0, 1, 1, 1, 0, 0])
JOINTS = np.array(
    [
        [0.0, 0.47, 0.0],
        [0.0, 0.62, 0.0],
        [0.0, 0.84, 0.0],
        [0.13, 0.75, 0.0],
        [-0.13, 0.75, 0.0],
        [0.09, 0.42, 0.0],
        [-0.09, 0.42, 0.0],
    ]
)
CAPSULES = (  # joint, ends, radius
    ("hips", (0.0, 0.45, 0.0), (0.0, 0.56, 0.0), 0.12),
    ("hips", (0.0, 0.46, -0.08), (0.0, 0.34, -0.30), 0.05),
    ("chest", (0.0, 0.64, 0.0), (0.0, 0.74, 0.0), 0.12),
    ("head", (0.0, 0.96, 0.0), (0.0, 0.93, 0.13), 0.12),
    ("leftArm", (0.15, 0.74, 0.0), (0.48, 0.52, 0.0), 0.055),
    ("rightArm", (-0.15, 0.74, 0.0), (-0.48, 0.52, 0.0), 0.055),
    ("leftLeg", (0.09, 0.40, 0.0), (0.13, 0.075, 0.0), 0.07),
    ("leftLeg", (0.13, 0.075, 0.0), (0.14, 0.066, 0.14), 0.05),
    ("rightLeg", (-0.09, 0.40, 0.0), (-0.13, 0.075, 0.0), 0.07),
    ("rightLeg", (-0.13, 0.075, 0.0), (-0.14, 0.066, 0.14), 0.05),
)


def make_creature(cell: float = 0.025) -> Character:
    """Make the creature with triangles of about `cell` metres, and one clip, "Wave"."""
    skeleton = make_skeleton()
    mesh = make_surface(cell)
    inverse_bind = np.linalg.inv(forward_kinematics(PARENTS, skeleton.rest))
    skin = Skin(true_weights(mesh.vertices), inverse_bind)
    return Character(mesh, skeleton, skin, (wave(skeleton),))


def make_skeleton() -> Skeleton:
    """Place the joints; frames are turned, as files have them: an arm's Y runs along the arm."""
    frames = np.tile(np.eye(3), (len(NAMES), 1, 1))
    frames[3:5] = Rotation.from_euler("z", [[-124], [124]], degrees=True).as_matrix()
    frames[5:] = Rotation.from_euler("x", 170, degrees=True).as_matrix()
    rest = local_transforms(PARENTS, compose_transforms(JOINTS, frames))
    return Skeleton(NAMES, PARENTS, rest)


def distances(points: np.ndarray) -> np.ndarray:
    """Give the signed distance of each point to each capsule, in metres."""
    columns = []
    for _, start, end, radius in CAPSULES:
        axis = np.subtract(end, start)
        along = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
        columns.append(np.linalg.norm(points - start - along[:, None] * axis, axis=1) - radius)
    return np.stack(columns, axis=1)


def make_surface(cell: float) -> Mesh:
    """Triangulate the smooth union of the capsules on a grid, facing outwards."""
    low, high = np.array([-0.6137, -0.0621, -0.4219]), np.array([0.6, 1.15, 0.32])
    counts = np.ceil((high - low) / cell).astype(int) + 1
    nodes = low + cell * np.indices(tuple(counts)).reshape(3, -1).T
    field = -0.02 * np.log(np.exp(-distances(nodes) / 0.02).sum(axis=1)).reshape(counts)
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(cell,) * 3)
    return Mesh(vertices.astype(np.float64) + low, faces.astype(np.int64))


def true_weights(points: np.ndarray) -> np.ndarray:
    """Skin points of the rest surface: each joint by how near its nearest capsule is."""
    near = np.exp(-distances(points) / 0.02)
    owners = np.array([[name == capsule[0] for name in NAMES] for capsule in CAPSULES], float)
    return keep_influences(near @ owners)


def pose_of(angles: dict[str, tuple[float, float, float]]) -> np.ndarray:
    """Turn the named joints by rotation vectors in degrees, in world axes, from rest."""
    turns = np.tile(np.eye(3), (len(NAMES), 1, 1))
    for name, vector in angles.items():
        turns[NAMES.index(name)] = Rotation.from_rotvec(vector, degrees=True).as_matrix()
    return turns


def world_pose(skeleton: Skeleton, turns: np.ndarray) -> np.ndarray:
    """Give world_from_joint after turning each joint by `turns`, in world axes as at rest."""
    frames = forward_kinematics(skeleton.parents, skeleton.rest)[:, :3, :3]
    local = np.swapaxes(frames, 1, 2) @ turns @ frames
    return forward_kinematics(skeleton.parents, pose_joints(skeleton.rest, local))


def move(character: Character, world: np.ndarray) -> np.ndarray:
    """Give the character's vertices with its joints at `world`."""
    motion = world @ character.skin.inverse_bind
    return linear_blend_skinning(character.mesh.vertices, character.skin.weights, motion)


def wave(skeleton: Skeleton, frames: int = 8) -> Clip:
    """Raise the left arm, swing a leg, nod and twist the chest while walking half a metre."""
    share = np.linspace(0.0, 1.0, frames)
    rest_frames = forward_kinematics(skeleton.parents, skeleton.rest)[:, :3, :3]
    vectors = np.zeros((frames, len(NAMES), 3))
    vectors[:, NAMES.index("leftArm")] = share[:, None] * [0.0, 0.2, 1.2]
    vectors[:, NAMES.index("leftLeg")] = np.sin(6 * share)[:, None] * [0.6, 0.0, 0.0]
    vectors[:, NAMES.index("head")] = share[:, None] * [0.4, 0.3, 0.0]
    vectors[:, NAMES.index("chest")] = share[:, None] * [0.0, 0.5, 0.0]
    local = np.swapaxes(rest_frames, 1, 2) @ vectors_to_matrices(vectors) @ rest_frames
    quaternions = matrices_to_quaternions(skeleton.rest[:, :3, :3] @ local)
    translations = np.tile(skeleton.rest[:, :3, 3], (frames, 1, 1))
    translations[:, 0] += share[:, None] * [0.0, 0.05, 0.5]
    return Clip("Wave", share, translations, quaternions, np.ones((frames, len(NAMES), 3)))

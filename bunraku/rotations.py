"""Rotations and rigid transforms as arrays; conversions themselves are SciPy's.

Names are a grammar: `a_from_b` is a matrix, `rotation` a 3x3 matrix, `quaternion` is xyzw.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

Matrices = Float[np.ndarray, "*batch 3 3"]


def quaternions_to_matrices(quaternions: Float[np.ndarray, "*batch 4"]) -> Matrices:
    """Turn unit quaternions xyzw into rotation matrices."""
    flat = Rotation.from_quat(quaternions.reshape(-1, 4)).as_matrix()
    return flat.reshape(*quaternions.shape[:-1], 3, 3)


def matrices_to_quaternions(rotations: Matrices) -> Float[np.ndarray, "*batch 4"]:
    """Turn rotation matrices into unit quaternions xyzw, w >= 0."""
    flat = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat(canonical=True)
    return flat.reshape(*rotations.shape[:-2], 4)


def vectors_to_matrices(vectors: Float[np.ndarray, "*batch 3"]) -> Matrices:
    """Turn rotation vectors (axis times angle) into matrices (Rodrigues)."""
    flat = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    return flat.reshape(*vectors.shape[:-1], 3, 3)


def matrices_to_vectors(rotations: Matrices) -> Float[np.ndarray, "*batch 3"]:
    """Turn rotation matrices into rotation vectors of at most pi."""
    flat = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*rotations.shape[:-2], 3)


def rotation_angles(rotations: Matrices) -> Float[np.ndarray, "*batch"]:
    """Give the angle of each rotation, in radians, 0 to pi."""
    return np.asarray(np.linalg.norm(matrices_to_vectors(rotations), axis=-1))


def nearest_rotation(matrices: Matrices) -> Matrices:
    """Project matrices on the rotations: the R that maximises trace(R^T M) (Kabsch)."""
    left, _, right = np.linalg.svd(matrices)
    left = left.copy()
    left[..., :, 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    return left @ right


def rotation_between(
    source: Float[np.ndarray, "*batch 3"], target: Float[np.ndarray, "*batch 3"]
) -> Matrices:
    """Give the smallest rotation that turns each source direction into its target direction."""
    source = source / np.linalg.norm(source, axis=-1, keepdims=True)
    target = target / np.linalg.norm(target, axis=-1, keepdims=True)
    axis = np.cross(source, target)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    cosine = np.sum(source * target, axis=-1, keepdims=True)
    fallback = np.cross(source, np.eye(3)[np.argmin(np.abs(source), axis=-1)])
    fallback /= np.linalg.norm(fallback, axis=-1, keepdims=True)
    unit = np.where(sine > 1e-9, axis / np.maximum(sine, 1e-12), fallback)
    return vectors_to_matrices(unit * np.arctan2(sine, cosine))


def compose_transforms(
    translations: Float[np.ndarray, "*batch 3"],
    rotations: Matrices,
    scales: Float[np.ndarray, "*batch 3"] | None = None,
) -> Float[np.ndarray, "*batch 4 4"]:
    """Build translate @ rotate @ scale as 4x4 matrices."""
    transforms = np.zeros((*rotations.shape[:-2], 4, 4))
    transforms[..., :3, :3] = rotations if scales is None else rotations * scales[..., None, :]
    transforms[..., :3, 3] = translations
    transforms[..., 3, 3] = 1.0
    return transforms


def decompose_transforms(
    transforms: Float[np.ndarray, "*batch 4 4"],
) -> tuple[Float[np.ndarray, "*batch 3"], Matrices, Float[np.ndarray, "*batch 3"]]:
    """Split 4x4 matrices into translation, rotation and scale along the axes; shear is dropped."""
    linear = transforms[..., :3, :3]
    rotations = nearest_rotation(linear)
    scales = np.einsum("...ij,...ij->...j", rotations, linear)
    return transforms[..., :3, 3].copy(), rotations, scales


def invert_rigid(transforms: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """Invert rotations with translation, exactly and without a general solve."""
    inverse = np.swapaxes(transforms[..., :3, :3], -1, -2)
    return compose_transforms(
        -np.einsum("...ij,...j->...i", inverse, transforms[..., :3, 3]), inverse
    )


def vertical_turn(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Give the part of a rotation that turns about the vertical (Y), nearest to it."""
    yaw = np.arctan2(rotation[0, 2] - rotation[2, 0], rotation[0, 0] + rotation[2, 2])
    return vectors_to_matrices(np.array([0.0, float(yaw), 0.0]))

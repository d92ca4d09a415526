"""Bodies of which all is known: surface, part weights and joints; and what is asserted of them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from bunraku.meshes import face_normals, interpolate, sample_surface
from bunraku.neural.anatomy import ANATOMIES, Anatomy
from bunraku.rotations import compose_transforms
from bunraku.skinning import linear_blend_skinning
from bunraku.types import NO_PARENT, Mesh


@dataclass(frozen=True, eq=False)
class Body:
    """A body at rest: height 1 or length 1, whichever is longer; Y up, facing +Z, left is +X."""

    family: str  # how it was made
    kind: str  # which anatomy it has
    mesh: Mesh
    weights: Float[np.ndarray, "vertices parts"]
    joints: Float[np.ndarray, "parts 3"]

    @property
    def anatomy(self) -> Anatomy:
        """Give the tree of its parts."""
        return ANATOMIES[self.kind]


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a body's surface with all that is known of them."""

    kind: str
    points: Float[np.ndarray, "points 3"]
    normals: Float[np.ndarray, "points 3"]
    weights: Float[np.ndarray, "points parts"]
    joints: Float[np.ndarray, "parts 3"]


def normalise(points: Float[np.ndarray, "points 3"]) -> tuple[Float[np.ndarray, "3"], float]:
    """Give the middle of the points' box, to subtract, and its longest side, to divide by."""
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, max(float((high - low).max()), 1e-9)


def sample_cloud(body: Body, count: int, rng: np.random.Generator) -> Cloud:
    """Draw points evenly from a body's surface."""
    mesh = body.mesh
    face, barycentric = sample_surface(mesh.vertices, mesh.faces, count, rng)
    corners = mesh.faces[face]
    normals = face_normals(mesh.vertices, corners)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Cloud(
        body.kind,
        interpolate(mesh.vertices, corners, barycentric),
        normals,
        interpolate(body.weights, corners, barycentric),
        body.joints,
    )


def pose_motion(
    joints: Float[np.ndarray, "parts 3"],
    parents: Int[np.ndarray, " parts"],
    turns: Float[np.ndarray, "*frames parts 3 3"],
    shift: Float[np.ndarray, "*frames 3"] | None = None,
) -> Float[np.ndarray, "*frames parts 4 4"]:
    """Turn parts (in world axes, since rest) and keep them together at their joints.

    p_k = p_parent + A_parent (j_k - j_parent); a point x of part k goes to A_k (x - j_k) + p_k.

    Args:
        joints: at rest.
        turns: of each part since rest; any linear maps will do.
        shift: how the root's joint moves; not at all by default.

    Returns:
        world_from_world of each part since rest.
    """
    places = np.empty((*turns.shape[:-2], 3))
    for part, parent in enumerate(parents):
        if parent == NO_PARENT:
            places[..., part, :] = joints[part] + (0.0 if shift is None else shift)
        else:
            arm = turns[..., parent, :, :] @ (joints[part] - joints[parent])
            places[..., part, :] = places[..., parent, :] + arm
    return compose_transforms(places - np.einsum("...kab,kb->...ka", turns, joints), turns)


def pose_body(
    body: Body,
    turns: Float[np.ndarray, "*frames parts 3 3"],
    shift: Float[np.ndarray, "*frames 3"] | None = None,
) -> Float[np.ndarray, "*frames vertices 3"]:
    """Move a body's vertices by turns of its parts."""
    motion = pose_motion(body.joints, body.anatomy.parents, turns, shift)
    return linear_blend_skinning(body.mesh.vertices, body.weights, motion)


def joint_gaps(body: Body) -> Float[np.ndarray, " parts"]:
    """Measure how far each joint is from the nearest vertex that its part moves most or shares.

    A part that moves no vertex has no gap: nan.
    """
    gaps = np.full(len(body.joints), np.nan)
    for part, joint in enumerate(body.joints):
        own = body.weights[:, part] > 0.25
        if own.any():
            gaps[part] = KDTree(body.mesh.vertices[own]).query(joint)[0]
    return gaps


def check_body(body: Body, *, farthest: float = 0.3) -> None:
    """Assert that a body is what it claims to be: finite, whole weights, joints near their parts.

    Args:
        farthest: how far a joint may be from its part, in heights; a pig has a deep spine.
    """
    assert np.isfinite(body.joints).all() and np.isfinite(body.weights).all(), body.family
    assert (body.weights >= 0).all() and np.allclose(body.weights.sum(axis=1), 1, atol=1e-4)
    gaps = joint_gaps(body)
    assert not (gaps > farthest).any(), (body.family, body.anatomy.names[np.nanargmax(gaps)], gaps)
    still = np.broadcast_to(np.eye(3), (len(body.joints), 3, 3))
    assert np.abs(pose_body(body, still) - body.mesh.vertices).max() < 1e-9, "rest is not static"

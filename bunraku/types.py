"""The nouns of the package: immutable, checked once when built, trusted afterwards.

Metres, seconds, radians, right-handed, Y up, facing +Z, quaternions xyzw. Matrices act on column
vectors and are named `to_from`, so that neighbouring names must match:
`world_from_joint = world_from_parent @ parent_from_joint`.

A *joint* is a point and frame, a *bone* the segment between two. The skeleton's *rest* is the pose
in which the skin was bound; for files it comes from the inverse bind matrices, never from the
nodes' default transforms.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.errors import Code

NO_PARENT = -1


class FormatError(ValueError):
    """A file that cannot be read: which one, where in it, what is wrong, how to fix it.

    Args:
        path: the file as the user named it.
        where: a JSON pointer, a line, a frame; empty if the whole file is meant.
        message: what was wanted, what came, and what to do.
        code: which fault it is; stable, for programs.
    """

    def __init__(self, path: object, where: str, message: str, *, code: Code = Code.INPUT) -> None:
        self.path, self.where, self.message, self.code = str(path), where, message, code
        super().__init__(f"{self.path}: {where + ': ' if where else ''}{message}")


class MatchError(ValueError):
    """A figure that was understood but cannot be matched to the performance well enough."""


def check_shape(name: str, array: np.ndarray, shape: tuple[int, ...], why: str) -> None:
    """Raise a ValueError that a user can act on, unless `array` has this shape."""
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape} ({why}), got {array.shape}")


def check_finite(name: str, array: np.ndarray) -> None:
    """Raise a ValueError naming the first entry that is NaN or infinite."""
    bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    if bad.any():
        raise ValueError(f"{name} must be finite; {bad.sum()} are not, first {int(bad.argmax())}")


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh; without faces, a point cloud."""

    vertices: Float[np.ndarray, "vertices 3"]
    faces: Int[np.ndarray, "faces 3"]

    def __post_init__(self) -> None:
        check_shape("vertices", self.vertices, (len(self.vertices), 3), "x, y, z each")
        check_shape("faces", self.faces, (len(self.faces), 3), "three corners each")
        check_finite("vertices", self.vertices)
        if len(self.faces) and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            wrong = int(
                ((self.faces < 0) | (self.faces >= len(self.vertices))).any(axis=1).argmax()
            )
            raise ValueError(
                f"face {wrong} is {self.faces[wrong].tolist()}, but there are "
                f"{len(self.vertices)} vertices, counted from 0"
            )


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of joints in its rest pose, every parent stored before its children."""

    names: tuple[str, ...]
    parents: Int[np.ndarray, " joints"]  # NO_PARENT for a root
    rest: Float[np.ndarray, "joints 4 4"]  # parent_from_joint

    def __post_init__(self) -> None:
        count = len(self.names)
        check_shape("parents", self.parents, (count,), "one per name")
        check_shape("rest", self.rest, (count, 4, 4), "one matrix per name")
        check_finite("rest", self.rest)
        for joint, parent in enumerate(self.parents):
            if not NO_PARENT <= parent < joint:
                raise ValueError(
                    f"joint {joint} ({self.names[joint]!r}) has parent {parent}: a parent must be "
                    f"{NO_PARENT} (a root) or come before its child; sort the joints root first"
                )


@dataclass(frozen=True, eq=False)
class Skin:
    """How much each joint moves each vertex, and where the joints were when that was decided."""

    weights: Float[np.ndarray, "vertices joints"]  # >= 0, every row sums to 1
    inverse_bind: Float[np.ndarray, "joints 4 4"]  # joint_from_world in the bind pose

    def __post_init__(self) -> None:
        joints = self.weights.shape[1]
        check_shape("inverse_bind", self.inverse_bind, (joints, 4, 4), "one per weight column")
        # `not >=` rather than `<`: NaN must count as wrong
        wrong = ~(self.weights >= 0).all(axis=1) | ~(np.abs(self.weights.sum(axis=1) - 1) <= 1e-4)
        if wrong.any():
            first = int(wrong.argmax())
            raise ValueError(
                f"skinning weights must be >= 0 and sum to 1 at every vertex; {wrong.sum()} "
                f"vertices do not (vertex {first} sums to {self.weights[first].sum():.4f}); "
                "skinning.keep_influences repairs them"
            )


@dataclass(frozen=True, eq=False)
class Clip:
    """A motion of a skeleton, sampled at rising times: parent_from_joint as its three parts."""

    name: str
    times: Float[np.ndarray, " frames"]
    translations: Float[np.ndarray, "frames joints 3"]
    rotations: Float[np.ndarray, "frames joints 4"]  # unit quaternions xyzw
    scales: Float[np.ndarray, "frames joints 3"]

    def __post_init__(self) -> None:
        frames, joints = self.rotations.shape[:2]
        check_shape("times", self.times, (frames,), "one per frame of rotations")
        check_shape("translations", self.translations, (frames, joints, 3), "as rotations")
        check_shape("rotations", self.rotations, (frames, joints, 4), "quaternions xyzw")
        check_shape("scales", self.scales, (frames, joints, 3), "as rotations")
        for name in ("times", "translations", "rotations", "scales"):
            check_finite(f"clip {self.name!r} {name}", getattr(self, name))
        if frames == 0 or (np.diff(self.times) <= 0).any():
            raise ValueError(f"clip {self.name!r} needs at least one frame, and rising times")


@dataclass(frozen=True, eq=False)
class Character:
    """A mesh with the skeleton and skin that move it, and the clips it came with."""

    mesh: Mesh
    skeleton: Skeleton
    skin: Skin
    clips: tuple[Clip, ...] = ()

    def __post_init__(self) -> None:
        joints = len(self.skeleton.names)
        shape = len(self.mesh.vertices), joints
        check_shape("skin.weights", self.skin.weights, shape, "mesh vertices, skeleton joints")
        for clip in self.clips:
            if clip.rotations.shape[1] != joints:
                raise ValueError(
                    f"clip {clip.name!r} moves {clip.rotations.shape[1]} joints, "
                    f"the skeleton has {joints}"
                )


@dataclass(frozen=True, eq=False)
class Figure:
    """A mesh file as it was found: geometry to work on, and the document to give back."""

    path: str
    mesh: Mesh  # every piece of the file in one, in world space, as stored (not welded)
    pieces: Int[np.ndarray, " vertices"]  # which piece of the file (primitive) each vertex is of
    document: object = None  # what the reader keeps for its own writer; nobody else looks inside
    world_from_file: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))

    def __post_init__(self) -> None:
        check_shape("pieces", self.pieces, (len(self.mesh.vertices),), "one per vertex")


@dataclass(frozen=True, eq=False)
class DepthVideo:
    """What one still camera saw of one moving subject, as distances along its axis."""

    path: str
    times: Float[np.ndarray, " frames"]  # seconds, rising
    depths: Float[np.ndarray, "frames rows columns"]  # metres; 0 where nothing was measured
    intrinsics: Float[np.ndarray, "3 3"]  # pixels_from_camera, K
    masks: Bool[np.ndarray, "frames rows columns"] | None = None  # where the subject is, if known

    def __post_init__(self) -> None:
        check_shape("times", self.times, (len(self.depths),), "one per depth frame")
        check_shape("intrinsics", self.intrinsics, (3, 3), "the camera's matrix K")
        check_finite("intrinsics", self.intrinsics)
        if len(self.times) < 1 or (np.diff(self.times) <= 0).any():
            raise ValueError("a depth video needs at least one frame, and rising times")
        if self.masks is not None:
            check_shape("masks", self.masks, self.depths.shape, "one pixel per depth")

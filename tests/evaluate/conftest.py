from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bunraku.skinning import forward_kinematics
from bunraku.types import Character, Clip, Mesh, Skeleton, Skin


def bend(name: str, skeleton: Skeleton, angle: float, *, frames: int = 9) -> Clip:
    """Turn the second joint by up to `angle` about Z and walk forwards, at 30 frames a second."""
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, angle, frames), [0.0, 0, 1.0]))
    rotations = np.tile([0.0, 0, 0, 1], (frames, len(skeleton.names), 1))
    rotations[:, 1] = turns.as_quat()
    translations = np.tile(skeleton.rest[:, :3, 3], (frames, 1, 1))
    translations[:, 0, 2] += np.linspace(0, 0.2, frames)
    times = np.arange(frames) / 30
    return Clip(name, times, translations, rotations, np.ones((frames, len(skeleton.names), 3)))


def make_stick(height: float, *, width: float = 0.1, prefix: str = "") -> Character:
    """Make a closed square tube along Y, bent in the middle by its second of two joints."""
    levels = np.linspace(0, height, 21)
    ring = width * np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
    vertices = np.array([[x, y, z] for y in levels for z, x in ring])
    below = np.arange(4 * (len(levels) - 1)).reshape(-1, 4)
    following = np.roll(below, -1, axis=1)
    quads = np.stack([below, following, following + 4, below + 4], axis=-1).reshape(-1, 4)
    top = len(vertices) - 4
    quads = np.vstack([quads, [[3, 2, 1, 0]], [[top, top + 1, top + 2, top + 3]]])
    faces = np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    rest = np.tile(np.eye(4), (2, 1, 1))
    rest[1, 1, 3] = height / 2
    skeleton = Skeleton(("root", "tip"), np.array([-1, 0]), rest)
    upper = np.clip((vertices[:, 1] / height - 0.4) / 0.2, 0, 1)
    inverse_bind = np.linalg.inv(forward_kinematics(skeleton.parents, rest))
    stick = Character(
        Mesh(vertices, faces),
        skeleton,
        Skin(np.column_stack([1 - upper, upper]), inverse_bind),
    )
    clips = [("Bend", 1.0), ("Nod", 0.5), ("Wave", -1.2)]
    return replace(
        stick, clips=tuple(bend(prefix + name, skeleton, angle) for name, angle in clips)
    )


@pytest.fixture
def stick() -> Character:
    return make_stick(1.0, prefix="Armature|Stick_")


@pytest.fixture
def tall_stick() -> Character:
    return make_stick(2.0, width=0.15, prefix="Tall_")

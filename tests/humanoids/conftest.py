"""A person made of 26 joints in T-pose, called by VRM's names."""

import numpy as np
import pytest

from bunraku.types import Clip, Skeleton

TRUNK = {
    "hips": ("", (0, 1.0, 0)),
    "spine": ("hips", (0, 0.1, -0.01)),
    "chest": ("spine", (0, 0.15, 0.0)),
    "upperChest": ("chest", (0, 0.15, 0.0)),
    "neck": ("upperChest", (0, 0.15, 0.0)),
    "head": ("neck", (0, 0.1, 0.01)),
    "headTop": ("head", (0, 0.2, 0)),
}
LIMB = {
    "UpperLeg": ("hips", (0.1, -0.05, 0)),
    "LowerLeg": ("UpperLeg", (0, -0.42, 0.01)),
    "Foot": ("LowerLeg", (0, -0.43, -0.02)),
    "Toes": ("Foot", (0, -0.08, 0.14)),
    "ToesTip": ("Toes", (0, 0, 0.06)),
    "Shoulder": ("upperChest", (0.05, 0.1, 0)),
    "UpperArm": ("Shoulder", (0.13, 0, 0)),
    "LowerArm": ("UpperArm", (0.28, 0, 0)),
    "Hand": ("LowerArm", (0.26, 0, 0)),
    "HandTip": ("Hand", (0.1, 0, 0)),
}


def make_person() -> Skeleton:
    joints = dict(TRUNK)
    for side, sign in (("left", 1), ("right", -1)):
        for bone, (parent, (x, y, z)) in LIMB.items():
            above = parent if parent in TRUNK else side + parent
            joints[side + bone] = (above, (sign * x, y, z))
    names = tuple(joints)
    rest = np.tile(np.eye(4), (len(names), 1, 1))
    rest[:, :3, 3] = [offset for _, offset in joints.values()]
    parents = [names.index(parent) if parent else -1 for parent, _ in joints.values()]
    return Skeleton(names, np.array(parents), rest)


@pytest.fixture
def person() -> Skeleton:
    return make_person()


@pytest.fixture
def dance(person, rng) -> Clip:
    """Twelve frames of mild random turns, knees bending back and elbows forward."""
    frames, joints = 12, len(person.names)
    vectors = rng.uniform(-0.25, 0.25, (frames, joints, 3))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        bend = rng.uniform(0.6, 1.6, frames)
        vectors[:, person.names.index(f"{side}LowerLeg")] = bend[:, None] * [1.0, 0, 0]
        vectors[:, person.names.index(f"{side}LowerArm")] = bend[:, None] * [0, -sign, 0]
    half = np.linalg.norm(vectors, axis=-1, keepdims=True) / 2
    quaternions = np.concatenate([vectors * np.sinc(half / np.pi) / 2, np.cos(half)], axis=-1)
    translations = np.tile(person.rest[:, :3, 3], (frames, 1, 1))
    translations[:, 0] += np.linspace(0, 1, frames)[:, None] * [0.2, 0, 1.0]
    times = np.arange(frames) / 30.0
    return Clip("dance", times, translations, quaternions, np.ones((frames, joints, 3)))

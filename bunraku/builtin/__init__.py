"""The built-in human, its clips, two demo figures, a network; made by scripts, never by hand.

    character = human()                    # A-pose, closed mesh, VRM 1.0 joint names, all clips
    labels, names = human_parts()          # names[labels[vertex]]: "head", "leftLowerArm", ...
    figure_paths()["stylised"]             # an unrigged .glb to animate

Every joint frame of the human is aligned with the world at rest. Sources and licences are in
docs/credits.md.
"""

from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from bunraku.rotations import compose_transforms
from bunraku.types import NO_PARENT, Character, Clip, Mesh, Skeleton, Skin

FOLDER = Path(__file__).parent


@cache
def human() -> Character:
    """Load the built-in adult: mesh, skeleton, skin and all its clips.

    The character is shared by all callers: copy an array before you change it.
    """
    stored = _load("human")
    joints, parents = stored["joints"].astype(np.float64), stored["parents"].astype(np.int64)
    identity = np.broadcast_to(np.eye(3), (len(joints), 3, 3))
    offsets = joints - np.where((parents == NO_PARENT)[:, None], 0.0, joints[parents])
    skeleton = Skeleton(
        tuple(map(str, stored["names"])), parents, compose_transforms(offsets, identity)
    )
    weights = np.zeros((len(stored["vertices"]), len(joints)))
    weights[np.arange(len(weights))[:, None], stored["influences"]] = stored["weights"]
    weights /= weights.sum(axis=1, keepdims=True)
    mesh = Mesh(stored["vertices"].astype(np.float64), stored["faces"].astype(np.int64))
    skin = Skin(weights, compose_transforms(-joints, identity))
    return Character(mesh, skeleton, skin, _clips(offsets))


@cache
def human_parts() -> tuple[Int[np.ndarray, " vertices"], tuple[str, ...]]:
    """Give the part of each vertex of the human, and the names that the numbers stand for."""
    stored = _load("human")
    return stored["parts"].astype(np.int64), tuple(map(str, stored["part_names"]))


def figure_paths() -> dict[str, Path]:
    """Name the two unrigged figures of the demo: "stylised" and "realistic"."""
    return {name: FOLDER / f"{name}.glb" for name in ("stylised", "realistic")}


def shape_network() -> bytes:
    """Read the weights of the shape network that `bunraku train shape` made (safetensors)."""
    return (FOLDER / "shape.safetensors").read_bytes()


def _load(name: str) -> dict[str, np.ndarray]:
    with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as stored:
        return dict(stored)


def _clips(offsets: Float[np.ndarray, "joints 3"]) -> tuple[Clip, ...]:
    """Complete the stored clips: only the hips move, all other joints just turn."""
    stored = _load("clips")
    clips, start = [], 0
    for name, count in zip(stored["names"], stored["frames"], strict=True):
        frames = slice(start, start + int(count))
        rotations = stored["rotations"][frames].astype(np.float64)
        rotations /= np.linalg.norm(rotations, axis=-1, keepdims=True)
        translations = np.tile(offsets, (len(rotations), 1, 1))
        translations[:, 0] = stored["hips"][frames]
        times = np.arange(len(rotations)) / float(stored["rate"])
        clips.append(Clip(str(name), times, translations, rotations, np.ones_like(translations)))
        start = frames.stop
    return tuple(clips)

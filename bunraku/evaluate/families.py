"""Find characters that can be compared: one rig, other bodies, clips of the same name.

Families are found by structure, not by name: files of one folder that share most joint names.
"""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bunraku.formats import read_character
from bunraku.skinning import clip_transforms, forward_kinematics, linear_blend_skinning
from bunraku.types import Character, Clip, FormatError, Mesh

logger = logging.getLogger(__name__)
RIGGED_SUFFIXES = {".glb", ".gltf", ".vrm"}


@dataclass(frozen=True, eq=False)
class Member:
    """A rigged character of the evaluation data and the file it came from."""

    path: Path
    character: Character

    @property
    def name(self) -> str:
        """Give the file's name without its ending."""
        return self.path.stem


def strip(character: Character) -> Mesh:
    """Take the rig away: the mesh in its bind pose."""
    return character.mesh


def freeze(character: Character, clip: Clip) -> Mesh:
    """Take the rig away in the middle of a clip: a figure in another pose than its rest."""
    vertices = play_at(character, clip, np.array([0.5]))[0]
    return Mesh(vertices, character.mesh.faces)


def motion_at(
    character: Character, clip: Clip, phases: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames joints 4 4"]:
    """Give each joint's motion since the bind pose at shares 0 to 1 of a clip's length.

    Between frames the matrices are blended, so that vertices move on straight lines.
    """
    moment = clip.times[0] + phases * (clip.times[-1] - clip.times[0])
    place = np.interp(moment, clip.times, np.arange(len(clip.times)))
    before, after = np.floor(place).astype(np.int64), np.ceil(place).astype(np.int64)
    world = forward_kinematics(character.skeleton.parents, clip_transforms(clip))
    motion = world @ character.skin.inverse_bind
    share = (place - before)[:, None, None, None]
    return (1 - share) * motion[before] + share * motion[after]


def play_at(
    character: Character, clip: Clip, phases: Float[np.ndarray, " frames"]
) -> Float[np.ndarray, "frames vertices 3"]:
    """Give the vertices at shares 0 to 1 of a clip's length, on straight lines between frames."""
    motion = motion_at(character, clip, phases)
    return linear_blend_skinning(character.mesh.vertices, character.skin.weights, motion)


def bind_joints(character: Character) -> Float[np.ndarray, "joints 3"]:
    """Give where the joints are in the pose in which the skin was bound, in metres."""
    return np.linalg.inv(character.skin.inverse_bind)[:, :3, 3].copy()


def read_members(paths: Iterable[Path]) -> dict[Path, Member]:
    """Read the characters that can be read; log which cannot."""
    members = {}
    for path in paths:
        try:
            members[path] = Member(path, read_character(path))
        except FormatError as error:
            logger.info("not a character: %s", error)
    return members


def plain_names(clips: Iterable[Clip]) -> dict[str, Clip]:
    """Key clips by their name without what all names of the file begin with.

    `HumanArmature|Man_Walk` becomes `Walk`, if the others begin with `HumanArmature|Man_` too.
    """
    named = [(clip.name.split("|")[-1].split("_"), clip) for clip in clips]
    shared = _shared_words([words for words, _ in named]) if len(named) > 1 else 0
    return {"_".join(words[shared:]).lower(): clip for words, clip in named}


def _shared_words(names: Sequence[Sequence[str]]) -> int:
    """Count the words that all names begin with; the last word of a name is never shared."""
    count = 0
    for words in zip(*(name[:-1] for name in names), strict=False):
        if len(set(words)) > 1:
            break
        count += 1
    return count


def shared_joints(source: Character, target: Character) -> float:
    """Give the share of joint names that two characters have in common, of the larger rig."""
    ours, theirs = set(source.skeleton.names), set(target.skeleton.names)
    return len(ours & theirs) / max(len(ours), len(theirs))


def can_teach(source: Character, target: Character) -> bool:
    """Tell whether a target's truth is known for the source's clips.

    It is if both have clips of the same name, or if the target has none and takes the source's
    by joint name.
    """
    whole = len(source.mesh.faces) and len(target.mesh.faces) and source.clips
    if not whole or shared_joints(source, target) < 0.8:
        return False
    common = plain_names(source.clips).keys() & plain_names(target.clips).keys()
    return bool(common) or not target.clips


def common_clips(source: Character, target: Character) -> list[str]:
    """List the plain names of the clips a pair can be compared on, sorted, rest poses left out."""
    names = plain_names(source.clips)
    if target.clips:
        names = {name: names[name] for name in names.keys() & plain_names(target.clips).keys()}
    moving = [name for name, clip in names.items() if len(clip.times) > 2 and _moves(clip)]
    return sorted(moving)


def _moves(clip: Clip) -> bool:
    """Tell whether any joint turns in the course of a clip."""
    return bool(np.ptp(clip.rotations, axis=0).max() > 1e-2)


def choose_clips(names: Sequence[str], count: int) -> tuple[list[str], str | None]:
    """Choose clips to compare, spread over the list, and another one to freeze a figure in."""
    if len(names) < 2:
        return list(names), None
    count = min(count, len(names) - 1)
    picked = np.linspace(0, len(names) - 1, count).round().astype(np.int64)
    left = [name for i, name in enumerate(names) if i not in picked]
    return [names[i] for i in picked], left[len(left) // 2]


def rigged_files(folder: Path) -> dict[Path, list[Path]]:
    """List the files that may hold rigged characters, by the folder they share."""
    files: dict[Path, list[Path]] = {}
    for path in sorted(folder.rglob("*")):
        below = path.relative_to(folder).parts
        if path.suffix.lower() in RIGGED_SUFFIXES and "unrigged" not in below:
            files.setdefault(path.parent, []).append(path)
    return files

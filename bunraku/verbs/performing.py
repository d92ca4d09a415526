"""Who performs, and how: characters, recorded motions, chosen clips, landmarks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from bunraku import builtin
from bunraku.errors import Code
from bunraku.formats import read_character, read_motion
from bunraku.formats.files import Location, read_bytes
from bunraku.formats.sniffing import sniff
from bunraku.humanoids import transfer_motion
from bunraku.types import Character, Clip, Figure, FormatError
from bunraku.verbs.failing import about

BUILT_IN = "built-in human"
Landmarks = Mapping[str, tuple[float, float, float]]


def read_performer(path: Location | None = None) -> Character:
    """Read what a figure is to be moved by: a rigged character, a motion, or the built-in human.

    Args:
        path: a rigged .glb, .gltf, .vrm or .fbx; or a .bvh, which moves the built-in human; None
            for the built-in human and its clips.

    Raises:
        FormatError: if the file holds neither.
    """
    if path is None:
        return builtin.human()
    path = Path(path)
    if path.is_dir():
        message = "is a folder; give a rigged .glb, .gltf, .vrm or .fbx, or a .bvh"
        raise FormatError(path, "", message, code=Code.FILE_FOLDER)
    with about(path):
        if sniff(path, read_bytes(path)) != "bvh":
            character = read_character(path)
            if not len(character.mesh.faces):
                message = "has a rig but no surface to compare the figure with; give a whole file"
                raise FormatError(path, "", message, code=Code.RIG_NO_SURFACE)
            return character
        human = builtin.human()
        recorded, clip = read_motion(path)
        return replace(human, clips=(transfer_motion(recorded, clip, human.skeleton),))


def choose_clips(
    performer: Character, names: Sequence[str] | None, where: str = BUILT_IN
) -> tuple[Clip, ...]:
    """Choose the performer's clips by name; all of them if no name is given.

    Args:
        performer: whose clips they are.
        names: the ones to choose, in this order; each is given once.
        where: the performer's name in errors.

    Raises:
        FormatError: if there are no clips, or none of that name.
    """
    if not performer.clips:
        message = "has a rig but no clips; give an animated file, or use bunraku rig"
        raise FormatError(where, "", message, code=Code.CLIP_MISSING)
    known = {clip.name: clip for clip in performer.clips}
    for name in names or ():
        if name not in known:
            listed = ", ".join(repr(other) for other in known)
            message = f"has no clip {name!r}; it has {listed}"
            raise FormatError(where, "", message, code=Code.CLIP_MISSING)
    return tuple(known[name] for name in dict.fromkeys(names)) if names else performer.clips


def read_landmarks(given: Location | Landmarks | None, performer: Character) -> Landmarks | None:
    """Read where a few of the performer's joints are, in the coordinates of the figure's file.

    Args:
        given: a JSON file, or what would be in it: {"joint": (x, y, z), ...}.
        performer: whose joints they are.

    Raises:
        FormatError: if the file is not {"joint": [x, y, z], ...}, or the joint does not exist.
    """
    if given is None:
        return None
    path = "landmarks" if isinstance(given, Mapping) else given
    try:
        kind = dict[str, tuple[float, float, float]]
        if isinstance(given, Mapping):
            landmarks = msgspec.convert(given, kind)
        else:
            landmarks = msgspec.json.decode(read_bytes(given), type=kind)
    except msgspec.MsgspecError as error:
        message = f'must be {{"joint name": [x, y, z], ...}}: {error}'
        raise FormatError(path, "", message, code=Code.LANDMARKS) from error
    known = performer.skeleton.names
    for name in landmarks:
        if name not in known:
            message = f"no such joint; the performance has {', '.join(known)}"
            raise FormatError(path, f"/{name}", message, code=Code.LANDMARKS)
    return landmarks


def place_landmarks(landmarks: Landmarks | None, found: Figure) -> Landmarks | None:
    """Turn places in the coordinates of the figure's file, Z up perhaps, into our frame."""
    if landmarks is None:
        return None
    turn, shift = found.world_from_file[:3, :3], found.world_from_file[:3, 3]
    placed = {name: (turn @ np.array(place) + shift).tolist() for name, place in landmarks.items()}
    return {name: (x, y, z) for name, (x, y, z) in placed.items()}

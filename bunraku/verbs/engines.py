"""Presets: what a game engine or Blender wants of a file, beyond what glTF already says.

Units and axes need no preset: glTF is metres, Y up, and every importer turns that into its own.
What differs is by which names a program knows a human's joints, and where it looks for travel:

| engine | names of human joints | root joint on the floor, with the travel | looping clips |
|---|---|---|---|
| blender | hips, upper_arm.L: what mirrors left and right there | no | as they are |
| godot | Hips, LeftUpperArm: SkeletonProfileHumanoid | "Root" | named NAME-loop |
| unity | Hips, LeftUpperArm: HumanBodyBones | no | as they are |
| unreal | pelvis, upperarm_l: the UE5 mannequin's | "root" | as they are |

Joints that are no human's keep their names. Where every vertex is, in every frame, never changes.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from bunraku.humanoids import name_joints
from bunraku.rotations import quaternions_to_matrices, rotation_angles
from bunraku.skinning import clip_transforms, forward_kinematics
from bunraku.types import NO_PARENT, Character, Clip, MatchError, Skeleton, Skin

SAME_TURN, SAME_HEIGHT = np.radians(2.0), 0.01  # of first and last frame of a loop; of the hips'
SIDES = {"left": ("l", "L"), "right": ("r", "R")}
PHALANGES = {"Metacarpal": 1, "Proximal": 1, "Intermediate": 2, "Distal": 3}
UNREAL = {
    **{"hips": "pelvis", "spine": "spine_01", "chest": "spine_02", "upperChest": "spine_03"},
    **{"neck": "neck_01", "head": "head", "Shoulder": "clavicle", "UpperArm": "upperarm"},
    **{"LowerArm": "lowerarm", "Hand": "hand", "UpperLeg": "thigh", "LowerLeg": "calf"},
    **{"Foot": "foot", "Toes": "ball", "Thumb": "thumb", "Index": "index", "Middle": "middle"},
    **{"Ring": "ring", "Little": "pinky"},
}
BLENDER = {
    **{"hips": "hips", "spine": "spine", "chest": "chest", "upperChest": "upper_chest"},
    **{"neck": "neck", "head": "head", "jaw": "jaw", "Shoulder": "shoulder", "Eye": "eye"},
    **{"UpperArm": "upper_arm", "LowerArm": "forearm", "Hand": "hand", "UpperLeg": "thigh"},
    **{"LowerLeg": "shin", "Foot": "foot", "Toes": "toe", "Thumb": "thumb", "Index": "f_index"},
    **{"Middle": "f_middle", "Ring": "f_ring", "Little": "f_pinky"},
}


def name_bones(skeleton: Skeleton) -> dict[str, int]:
    """Find the joint of each bone of a human, by VRM 1.0 names; none if it is no human's."""
    try:
        return name_joints(skeleton)
    except MatchError:
        return {}


def prepare_for(character: Character, engine: str | None) -> Character:
    """Give joints and clips the names that a program knows, and a root joint where it wants one.

    Args:
        character: what moves.
        engine: one of ENGINES; None changes nothing.

    Raises:
        ValueError: if the engine is unknown.
    """
    if engine is None:
        return character
    if engine not in ENGINES:
        raise ValueError(f"no preset for {engine!r}; there are {', '.join(ENGINES)}")
    name, root, marks_loops = ENGINES[engine]
    bones = name_bones(character.skeleton)
    renamed = {joint: name(bone) for bone, joint in bones.items()}
    character = replace(character, skeleton=_rename(character.skeleton, renamed))
    if marks_loops:
        clips = tuple(_mark_loop(clip, bones.get("hips", 0)) for clip in character.clips)
        character = replace(character, clips=clips)
    return _add_root(character, root, bones.get("hips", 0)) if root else character


def _rename(skeleton: Skeleton, names: Mapping[int, str]) -> Skeleton:
    """Rename some joints; others that bear such a name step aside."""
    taken = set(names.values())
    kept = [f"{name}_other" if name in taken else name for name in skeleton.names]
    return replace(skeleton, names=tuple(names.get(j, name) for j, name in enumerate(kept)))


def _unity(bone: str) -> str:
    """Name a bone as HumanBodyBones does: the thumb's joints are one further in."""
    name = bone[0].upper() + bone[1:]
    if "Thumb" in name:
        name = name.replace("Proximal", "Intermediate").replace("Metacarpal", "Proximal")
    return name


def _godot(bone: str) -> str:
    return bone[0].upper() + bone[1:]


def _split(bone: str) -> tuple[str, str, int]:
    """Split a bone's name into side, part and number of the finger's joint, 0 for others."""
    side = next((side for side in SIDES if bone.startswith(side)), "")
    part = bone.removeprefix(side)
    for phalanx, number in PHALANGES.items():
        if side and part.endswith(phalanx):
            finger = part.removesuffix(phalanx)
            return side, finger, number + (finger == "Thumb" and phalanx == "Proximal")
    return side, part, 0


def _unreal(bone: str) -> str:
    side, part, number = _split(bone)
    if part not in UNREAL:
        return bone
    middle = f"_{number:02}" if number else ""
    return UNREAL[part] + middle + (f"_{SIDES[side][0]}" if side else "")


def _blender(bone: str) -> str:
    side, part, number = _split(bone)
    middle = f".{number:02}" if number else ""
    return BLENDER[part] + middle + (f".{SIDES[side][1]}" if side else "")


ENGINES: dict[str, tuple[Callable[[str], str], str, bool]] = {
    "blender": (_blender, "", False),
    "godot": (_godot, "Root", True),
    "unity": (_unity, "", False),
    "unreal": (_unreal, "root", False),
}  # how bones are called; the root joint; whether the names of loops end in -loop


def _mark_loop(clip: Clip, hips: int) -> Clip:
    """Add -loop to the name of a clip that ends as it began, but for the way travelled."""
    turns = quaternions_to_matrices(clip.rotations[[0, -1]])
    angles = rotation_angles(turns[1] @ turns[0].swapaxes(-1, -2))
    rise = abs(float(np.subtract(*clip.translations[[0, -1], hips, 1])))
    height = max(abs(float(clip.translations[0, hips, 1])), 1e-9)
    is_loop = len(clip.times) > 1 and angles.max() < SAME_TURN and rise < SAME_HEIGHT * height
    ends_so = clip.name.endswith("-loop")
    return replace(clip, name=f"{clip.name}-loop") if is_loop and not ends_so else clip


def _add_root(character: Character, name: str, hips: int) -> Character:
    """Add a joint at the origin above all others, and let it carry the hips along the floor."""
    skeleton, skin = character.skeleton, character.skin
    taken = {name: name + "_other"}
    names = (name, *(taken.get(other, other) for other in skeleton.names))
    parents = np.concatenate([[NO_PARENT], skeleton.parents + 1])
    start = forward_kinematics(skeleton.parents, skeleton.rest)[hips, :3, 3]
    identity = np.eye(4)[None]
    return Character(
        character.mesh,
        Skeleton(names, parents, np.concatenate([identity, skeleton.rest])),
        Skin(np.pad(skin.weights, ((0, 0), (1, 0))), np.concatenate([identity, skin.inverse_bind])),
        tuple(_let_root_travel(clip, skeleton, hips, start) for clip in character.clips),
    )


def _let_root_travel(clip: Clip, skeleton: Skeleton, hips: int, start: np.ndarray) -> Clip:
    """Take the way along the floor from the old roots and give it to a new one before them."""
    places = forward_kinematics(skeleton.parents, clip_transforms(clip))[:, hips, :3, 3]
    travel = (places - start) * (1.0, 0.0, 1.0)
    translations = clip.translations.copy()
    translations[:, skeleton.parents == NO_PARENT] -= travel[:, None]
    still = np.zeros((len(travel), 1, 4))
    still[..., 3] = 1.0
    return Clip(
        clip.name,
        clip.times,
        np.concatenate([travel[:, None], translations], axis=1),
        np.concatenate([still, clip.rotations], axis=1),
        np.concatenate([np.ones((len(travel), 1, 3)), clip.scales], axis=1),
    )

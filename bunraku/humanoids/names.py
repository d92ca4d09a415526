"""What the names of joints mean, in the dialects of the common rigs and recordings.

Mixamo (mixamorig:LeftUpLeg), MotionBuilder and Rokoko (LeftArm), CMU (LHipJoint, LeftCollar), 3ds
Max (Bip01 L Thigh), Unreal (thigh_l), Rigify (DEF-upper_arm.L.001), VRM (J_Bip_L_UpperArm,
leftUpperArm), Daz (lShldr), Character Creator (CC_Base_L_Calf), MakeHuman (lowerleg01.L, LoLeg_L).
"""

import re
from dataclasses import dataclass

# A limb's joints from the body outwards; a name that may mean either of two is in both.
ROLES = {
    "UpperLeg": {"upleg", "upperleg", "thigh", "femur", "legupper", "hip", "leg"},
    "LowerLeg": {"lowerleg", "lowleg", "loleg", "calf", "shin", "knee", "tibia", "leglower", "leg"},
    "Foot": {"foot", "ankle"},
    "Toes": {"toe", "toes", "toebase", "ball"},
    "Shoulder": {"clavicle", "clav", "collar", "collarbone", "shoulder"},
    "UpperArm": {"upperarm", "uparm", "arm", "shldr", "humerus", "bicep", "armupper", "shoulder"},
    "LowerArm": {"forearm", "lowerarm", "lowarm", "loarm", "elbow", "ulna", "armlower"},
    "Hand": {"hand", "wrist"},
    "hips": {"hips", "hip", "pelvis"},
    "head": {"head"},
    "jaw": {"jaw"},
    "Eye": {"eye"},
}
FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
_FINGER_WORDS = {
    **{"thumb": "Thumb", "index": "Index", "middle": "Middle", "mid": "Middle", "ring": "Ring"},
    **{"pinky": "Little", "pinkie": "Little", "little": "Little"},
}
_PREFIXES = {
    *{"j", "bip", "biped", "def", "cc", "base", "valve", "mixamorig", "armature", "rig", "jnt"},
    *{"joint", "bone", "bn", "sk", "skel", "character", "g", "b", "adj", "sec"},
}
_NO_BODY = {
    *{"ik", "pole", "poletarget", "target", "ctrl", "control", "twist", "roll", "helper", "tip"},
    *{"socket", "mch", "org", "aim", "attach", "weapon", "prop", "eff", "effector", "end", "nub"},
    *{"goal", "handle", "slot", "vis", "tweak"},
}
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_STEMS = {stem for stems in ROLES.values() for stem in stems}


@dataclass(frozen=True)
class JointName:
    """What a joint's name says."""

    side: str  # left, right or nothing
    stem: str  # the part of the body, small letters
    number: int  # 0 if there is none
    finger: str  # one of FINGERS, or nothing

    def may_be(self, role: str) -> bool:
        """Tell whether the stem is one of the role's."""
        return self.stem in ROLES[role]


def read_name(name: str) -> JointName:
    """Split a joint's name into side, part of the body and number."""
    name = re.split(r"[:|]", name)[-1]
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", name)
    words = [word.lower() for word in re.findall(r"[A-Za-z]+|\d+", spaced)]
    numbers = [int(word[:6]) for word in words if word.isdecimal()]
    letters = [word for word in words if not word.isdecimal()]
    if _NO_BODY & set(letters):
        return JointName("", "", 0, "")
    sides = [_SIDES[word] for word in letters if word in _SIDES]
    kept = [word for word in letters if word not in _SIDES and word not in _PREFIXES]
    stem = "".join(kept)
    if not sides:
        side, stem = _glued_side(stem)
        sides = [side] if side else []
    finger = next((_FINGER_WORDS[word] for word in kept if word in _FINGER_WORDS), "")
    if not finger:
        finger = next((value for word, value in _FINGER_WORDS.items() if word in stem), "")
    if "toe" in stem and stem not in _STEMS:
        finger = ""
    return JointName(sides[0] if sides else "", stem, numbers[-1] if numbers else 0, finger)


def _glued_side(stem: str) -> tuple[str, str]:
    """Split the side from a name in small letters only, such as rthigh or handleft."""
    for side in ("left", "right"):
        for rest in (stem.removeprefix(side), stem.removesuffix(side)):
            if rest != stem and rest in _STEMS:
                return side, rest
        if stem[:1] == side[0] and stem not in _STEMS and stem[1:] in _STEMS:
            return side, stem[1:]
    return "", stem

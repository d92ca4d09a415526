"""Find the joints of a human skeleton: by name first, by the shape of the tree where names fail."""

import itertools

import numpy as np

from bunraku.errors import doubt
from bunraku.humanoids.names import ROLES, JointName, read_name
from bunraku.humanoids.tree import Tree
from bunraku.types import NO_PARENT, MatchError, Skeleton

SIDES = ("left", "right")
LEG = ("UpperLeg", "LowerLeg", "Foot")
ARM = ("UpperArm", "LowerArm", "Hand")
SPINE = ("spine", "chest", "upperChest")
UP = np.array([0.0, 1.0, 0.0])
_THUMB = ("Metacarpal", "Proximal", "Distal")
_FINGER = ("Proximal", "Intermediate", "Distal")


def name_joints(skeleton: Skeleton) -> dict[str, int]:
    """Find the joints of a human skeleton.

    Names decide as far as they are known; legs or arms without known names are found as pairs of
    equally long branches. Left and right are checked against the way the feet point.

    Returns:
        joint of each VRM 1.0 bone that is there (hips, spine, leftUpperArm, ...).

    Raises:
        MatchError: if two legs and two arms cannot be told.
    """
    tree = Tree(skeleton)
    names = [read_name(name) for name in skeleton.names]
    called = _limbs_by_name(tree, names, LEG) | _limbs_by_name(tree, names, ARM)
    limbs = dict(called)
    if len(limbs) < 2 * len(LEG + ARM):
        legs, arms = _limb_pairs(tree)
        if f"left{LEG[0]}" not in limbs:
            limbs |= _limbs_by_shape(tree, legs, LEG)
        if f"left{ARM[0]}" not in limbs:
            limbs |= _limbs_by_shape(tree, arms, ARM)
    limbs = _mend_sides(tree, limbs, called)
    named = limbs | _trunk(tree, names, limbs)
    for side in SIDES:
        named |= _limb_ends(tree, names, named, side) | _fingers(tree, names, named, side)
    return named


def _limbs_by_name(tree: Tree, names: list[JointName], roles: tuple[str, ...]) -> dict[str, int]:
    """Find both limbs of a kind by name; nothing unless all joints of both are there."""
    found: dict[str, int] = {}
    for side in SIDES:
        own = {joint for joint, name in enumerate(names) if name.side == side and not name.finger}
        for end in sorted(joint for joint in own if names[joint].may_be(roles[2])):
            limb = _limb_by_name([j for j in tree.chain(end) if j in own], names, roles)
            if limb:
                found |= {side + role: joint for role, joint in zip(roles, limb, strict=True)}
                break
    return found if len(found) == 2 * len(roles) else {}


def _limb_by_name(
    chain: list[int], names: list[JointName], roles: tuple[str, ...]
) -> tuple[int, int, int] | None:
    """Find the three joints of a limb in the chain that ends with the third, by name."""
    upper = [joint for joint in chain[:-1] if names[joint].may_be(roles[0])]
    clear = [joint for joint in upper if names[joint].stem not in ("shoulder", "hip")]
    for first in clear or upper:
        later = chain[chain.index(first) + 1 : -1]
        if any(names[joint] == names[first] for joint in later):
            continue  # a helper of the same name sits above the joint that turns
        lower = [joint for joint in later if names[joint].may_be(roles[1])]
        if lower:
            return first, lower[0], chain[-1]
    return None


def _limb_pairs(tree: Tree) -> tuple[tuple[int, int], tuple[int, int]]:
    """Find legs and arms as the two pairs of long, equal branches that begin nearest the root."""
    enough = 0.25 * tree.reach.max(initial=0.0)
    whole = tree.reach + tree.lengths
    pairs = [
        (parent, first, second)
        for parent, children in enumerate(tree.children)
        for first, second in itertools.combinations(children, 2)
        if min(whole[first], whole[second]) > max(enough, 0.95 * max(whole[first], whole[second]))
        and abs(tree.sizes[first] - tree.sizes[second]) <= 0.2 * tree.sizes[first]
    ]
    pairs.sort(key=lambda pair: (len(tree.ancestors(pair[0])), -whole[pair[1]]))
    for legs, arms in itertools.combinations(pairs, 2):
        above_arms = set(tree.chain(arms[1]))
        if not above_arms & set(legs[1:]):
            return legs[1:], arms[1:]
    raise MatchError(
        f"a skeleton of {len(tree.parents)} joints shows no two legs and two arms, neither by name "
        "nor by shape; give a human performance or rename its joints as VRM does"
    )


def _limbs_by_shape(tree: Tree, pair: tuple[int, int], roles: tuple[str, ...]) -> dict[str, int]:
    """Find the joints of two limbs by the lengths of their bones; the sides may be exchanged."""
    found = {}
    for side, start in zip(SIDES, pair, strict=True):
        chain = tree.longest_chain(start)
        along = np.cumsum(tree.lengths[chain]) - tree.lengths[start]
        long_bone = 0.2 * along[-1]
        forks = [i for i, joint in enumerate(chain) if len(tree.children[joint]) > 2 and i > 1]
        end = forks[0] if forks and roles is ARM else 0
        end = end or int((along >= 0.75 * along[-1]).argmax())
        lower = max((i for i in range(end) if along[end] - along[i] > long_bone), default=-1)
        upper = max((i for i in range(lower) if along[lower] - along[i] > long_bone), default=-1)
        if min(lower, upper) < 0:
            raise MatchError(
                f"the branch of joint {start} has no two long bones; give a human performance"
            )
        for role, place in zip(roles, (upper, lower, end), strict=True):
            found[side + role] = chain[place]
    return found


def _mend_sides(tree: Tree, limbs: dict[str, int], called: dict[str, int]) -> dict[str, int]:
    """Exchange left and right of legs and arms where the way the feet point says so."""
    forward, legs = np.zeros(3), np.zeros(3)
    for side in SIDES:
        foot = limbs[f"{side}Foot"]
        forward += tree.places[tree.longest_chain(foot)[-1]] - tree.places[foot]
        legs += tree.places[foot] - tree.places[limbs[f"{side}UpperLeg"]]
    if legs @ UP > -0.8 * np.linalg.norm(legs):
        return limbs  # not standing at rest, so feet say nothing
    forward -= UP * forward[1]
    mended = dict(limbs)
    for roles in (LEG, ARM):
        apart = tree.places[limbs[f"left{roles[0]}"]] - tree.places[limbs[f"right{roles[0]}"]]
        if np.cross(UP, forward) @ apart < -0.1 * np.linalg.norm(apart) * np.linalg.norm(forward):
            for role in roles:
                mended[f"left{role}"], mended[f"right{role}"] = (
                    limbs[f"right{role}"],
                    limbs[f"left{role}"],
                )
            if f"left{roles[0]}" in called:
                doubt("joints called left lie on the right of the way the feet point")
    return mended


def _trunk(tree: Tree, names: list[JointName], limbs: dict[str, int]) -> dict[str, int]:
    """Find hips, spine, neck and head: the chain on which legs, arms and head hang."""
    legs = [limbs[f"{side}UpperLeg"] for side in SIDES]
    top = tree.junction([limbs[f"{side}UpperArm"] for side in SIDES])
    hips = tree.junction([*legs, top]) if top != NO_PARENT else NO_PARENT
    if hips == NO_PARENT:
        raise MatchError("legs and arms hang on different roots; give one connected skeleton")
    called_hips = [j for j in tree.ancestors(hips) if not names[j].side and names[j].may_be("hips")]
    if called_hips and not (not names[hips].side and names[hips].may_be("hips")):
        hips = called_hips[0]
    spine = [joint for joint in tree.chain(top) if joint in tree.below(hips)]
    named = {"hips": hips} | dict(zip(SPINE, _spread(spine, 3), strict=False))
    arms = {joint for side in SIDES for joint in tree.chain(limbs[f"{side}UpperArm"])}
    return named | _head(tree, names, top, [c for c in tree.children[top] if c not in arms])


def _spread(chain: list[int], count: int) -> list[int]:
    """Choose at most `count` joints of a chain: the first, the last, and evenly between."""
    places = np.linspace(0, len(chain) - 1, min(count, len(chain)))
    return [chain[round(place)] for place in places]


def _head(tree: Tree, names: list[JointName], top: int, free: list[int]) -> dict[str, int]:
    """Find neck and head above the joint on which the arms hang."""
    above = tree.below(top)
    heads = [j for j in above if not names[j].side and names[j].may_be("head")]
    if heads:
        head = heads[0]
    else:
        chain = tree.longest_chain(max(free, key=lambda j: tree.places[j][1])) if free else []
        inner = [joint for joint in chain if tree.children[joint]] or chain
        head = inner[min(1, len(inner) - 1)] if inner else NO_PARENT
    if head == NO_PARENT:
        return {}
    between = [joint for joint in tree.chain(head)[:-1] if joint in set(above)]
    found = {"neck": between[0]} if between else {}
    jaws = [j for j in tree.below(head) if names[j].may_be("jaw")]
    eyes = {f"{names[j].side}Eye": j for j in tree.below(head) if names[j].may_be("Eye")}
    found |= {name: joint for name, joint in eyes.items() if name != "Eye"}
    return found | {"head": head} | ({"jaw": jaws[-1]} if jaws else {})


def _limb_ends(
    tree: Tree, names: list[JointName], named: dict[str, int], side: str
) -> dict[str, int]:
    """Find the joints beyond the limbs' three: toes, and the shoulder between spine and arm."""
    found: dict[str, int] = {}
    below = tree.below(named[f"{side}Foot"])
    called = [j for j in below if names[j].stem in ROLES["Toes"]]
    toes = [j for j in below if tree.children[j]]
    if called or (toes and tree.parents[toes[0]] == named[f"{side}Foot"]):
        found[f"{side}Toes"] = (called or toes)[0]
    spine = max(named.get(bone, NO_PARENT) for bone in (*SPINE, "hips"))
    arm = named[f"{side}UpperArm"]
    between = [
        joint for joint in tree.ancestors(arm) if joint > spine and joint in tree.below(spine)
    ]
    if between:
        called = [j for j in between if names[j].may_be("Shoulder")]
        found[f"{side}Shoulder"] = (called or between)[0]
    return found


def _fingers(
    tree: Tree, names: list[JointName], named: dict[str, int], side: str
) -> dict[str, int]:
    """Find the fingers that have names, the last three joints with a bone of each."""
    found: dict[str, int] = {}
    chains: dict[str, list[int]] = {}
    for joint in tree.below(named[f"{side}Hand"]):
        finger = names[joint].finger
        if finger and (tree.children[joint] or tree.parents[joint] in chains.get(finger, [])):
            chains.setdefault(finger, []).append(joint)
    for finger, chain in chains.items():
        roles = _THUMB if finger == "Thumb" else _FINGER
        found |= {
            f"{side}{finger}{role}": joint
            for role, joint in zip(roles, chain[-3:] if len(chain) > 3 else chain, strict=False)
        }
    return found

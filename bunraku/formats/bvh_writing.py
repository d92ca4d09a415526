"""Write a clip as BVH: centimetres, Y up, rest frames along the world's axes, angles Z X Y."""

import re

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bunraku.graphs import children
from bunraku.rotations import nearest_rotation
from bunraku.skinning import clip_transforms, forward_kinematics
from bunraku.types import NO_PARENT, Clip, Skeleton

UNIT = 100.0  # centimetres in a metre
TIP = 0.3  # length of the last bone of a chain, as a share of the bone before it
STILL = 1e-4  # metres that an inner joint may leave its place without channels of its own
ANGLES = "Zrotation Xrotation Yrotation"
PLACES = "Xposition Yposition Zposition"
HIPS, INDENT = "root", "\t"


def encode_bvh(skeleton: Skeleton, clip: Clip) -> bytes:
    """Write the motion of a skeleton; scales, which the format does not know, are left out.

    A BVH joint is unturned at rest, so its world rotation is that of the joint since rest:
    world'(t) = world(t) rest^-1. Several roots get one above them. Frames are spaced evenly, as
    the clip's are on average; between its own they lie on straight lines.

    Args:
        skeleton: its rest pose becomes the BVH's.
        clip: of this skeleton.

    Returns:
        the bytes of the file.
    """
    parents, names = skeleton.parents, plain_names(skeleton.names)
    rest = forward_kinematics(parents, skeleton.rest)
    places, turns, step = _world_motion(skeleton, clip)
    if (parents == NO_PARENT).sum() > 1:  # the format has a single root
        parents, names = np.append(NO_PARENT, parents + 1), [HIPS, *names]
        rest = np.concatenate([np.eye(4)[None], rest])
        places = np.pad(places, ((0, 0), (1, 0), (0, 0)))
        turns = np.concatenate([np.tile(np.eye(3), (len(turns), 1, 1, 1)), turns], axis=1)
    above = np.maximum(parents, 0)
    is_root = parents == NO_PARENT
    offsets = rest[:, :3, 3] - np.where(is_root[:, None], 0.0, rest[above, :3, 3])
    carried = np.where(is_root[:, None, None], np.eye(3), turns[:, above])
    apart = places - np.where(is_root[:, None], 0.0, places[:, above])
    local = np.einsum("fjca,fjcb->fjab", carried, turns)
    shifts = np.einsum("fjca,fjc->fja", carried, apart)
    moves = is_root | (np.abs(shifts - offsets).max(axis=(0, 2)) > STILL)
    order, text = _describe(parents, names, UNIT * offsets, moves)
    angles = Rotation.from_matrix(local.reshape(-1, 3, 3)).as_euler("ZXY", degrees=True)
    angles = np.degrees(np.unwrap(np.radians(angles.reshape(*local.shape[:2], 3)), axis=0))
    columns = [
        part
        for j in order
        for part in ((UNIT * shifts[:, j],) if moves[j] else ()) + (angles[:, j],)
    ]
    table = np.concatenate(columns, axis=1)
    lines = [" ".join(f"{value:.6g}" for value in frame) for frame in table.tolist()]
    head = ["HIERARCHY", *text, "MOTION", f"Frames: {len(table)}", f"Frame Time: {step:.8g}"]
    return "\n".join([*head, *lines, ""]).encode()


def plain_names(names: tuple[str, ...]) -> list[str]:
    """Make names without spaces, all different, as programs that read BVH want them."""
    plain: list[str] = []
    for name in names:
        base = re.sub(r"[\s{}]+", "_", name) or "joint"
        taken, number = base, 1
        while taken in plain:
            number += 1
            taken = f"{base}_{number}"
        plain.append(taken)
    return plain


def _world_motion(
    skeleton: Skeleton, clip: Clip
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3 3"], float]:
    """Give where joints are, and how they are turned since rest, at even times; and their step."""
    rest = forward_kinematics(skeleton.parents, skeleton.rest)
    world = forward_kinematics(skeleton.parents, clip_transforms(clip))
    since_rest = nearest_rotation(world[..., :3, :3] @ np.linalg.inv(rest[:, :3, :3]))
    places, times = world[..., :3, 3], clip.times
    if len(times) < 2:
        return places, since_rest, 1 / 30
    step = float(times[-1] - times[0]) / (len(times) - 1)
    even = times[0] + step * np.arange(len(times))
    if np.abs(even - times).max() > 1e-3 * step:
        after = np.clip(np.searchsorted(times, even, side="right"), 1, len(times) - 1)
        share = ((even - times[after - 1]) / (times[after] - times[after - 1]))[:, None, None]
        places = (1 - share) * places[after - 1] + share * places[after]
        blend = share[..., None]
        since_rest = nearest_rotation(
            (1 - blend) * since_rest[after - 1] + blend * since_rest[after]
        )
    return places, since_rest, step


def _describe(
    parents: np.ndarray, names: list[str], offsets: np.ndarray, moves: np.ndarray
) -> tuple[list[int], list[str]]:
    """Write the tree depth first; give the order of the joints in it, and the lines."""
    below, order, text = children(parents), list[int](), list[str]()
    waiting: list[tuple[int, int]] = [(int((parents == NO_PARENT).argmax()), 0)]
    while waiting:
        joint, depth = waiting.pop()
        if joint < 0:  # the end of a joint whose children are all written
            text.append(f"{INDENT * depth}}}")
            continue
        order.append(joint)
        pad = INDENT * depth
        channels = f"6 {PLACES} {ANGLES}" if moves[joint] else f"3 {ANGLES}"
        text.append(f"{pad}{'JOINT' if depth else 'ROOT'} {names[joint]}")
        text += [f"{pad}{{", f"{pad}{INDENT}{_offset(offsets[joint])}"]
        text.append(f"{pad}{INDENT}CHANNELS {channels}")
        if not below[joint]:
            tip = TIP * offsets[joint] if depth else np.array([0.0, 1.0, 0.0])
            inner = f"{pad}{INDENT}"
            text += [
                f"{inner}End Site",
                f"{inner}{{",
                f"{inner}{INDENT}{_offset(tip)}",
                f"{inner}}}",
            ]
        waiting.append((-1, depth))
        waiting += [(child, depth + 1) for child in reversed(below[joint])]
    return order, text


def _offset(place: np.ndarray) -> str:
    return "OFFSET " + " ".join(f"{value:.6g}" for value in place.tolist())

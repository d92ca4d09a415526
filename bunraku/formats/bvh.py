"""BVH motion: `bvh_text` reads the words; units and axes are found here.

Libraries were tried and dropped: bvhio does not return on four damaged files, and takes seconds for
a recording that is read here in hundredths; pybvh, which the tests compare with, refuses what many
programs write, and brings 78 MB of matplotlib along.
"""

import logging
from collections.abc import Sequence
from pathlib import PurePath

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bunraku import limits
from bunraku.errors import Code, announce
from bunraku.formats.bvh_text import Recording, parse_recording
from bunraku.formats.files import Location
from bunraku.formats.text import UTF16_MARKS
from bunraku.rotations import compose_transforms
from bunraku.skinning import forward_kinematics
from bunraku.types import NO_PARENT, Clip, FormatError, Skeleton

SHORTEST_BODY, TALLEST_BODY = 0.5, 4.0  # metres; outside, a warning says so
INCH = 0.0254

logger = logging.getLogger(__name__)


def read_recording(path: Location, content: bytes) -> tuple[Skeleton, Clip]:
    """Read a BVH as a skeleton in metres, Y up, and a clip named after the file.

    The rest frames of all joints are unturned, with the file's offsets as translations. An end
    site becomes a joint named after its parent and `_end`, so that the last bones have a direction.

    Raises:
        FormatError: if the file is damaged, or holds more than 4096 joints or 100,000 frames.
    """
    if b"\0" in content and content[:2] not in UTF16_MARKS:
        message = "holds NUL bytes, which no text has: it is damaged; download it again"
        raise FormatError(path, "", message, code=Code.BVH_HIERARCHY)
    recording = parse_recording(path, content)
    _check(path, recording)
    _announce_oddities(path, recording)
    translations, rotations = _local_motion(path, recording)
    offsets = recording.offsets
    if _stands_along_z(recording, translations, rotations):
        logger.info("%s: stands along z; turned upright", path)
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        offsets, translations = offsets @ turn.T, translations @ turn.T
        rotations = turn @ rotations @ turn.T
    scale = _metres_per_unit(path, recording)
    rest = np.tile(np.eye(4), (len(offsets), 1, 1))
    rest[:, :3, 3] = offsets * scale
    frames, joints = rotations.shape[:2]
    clip = Clip(
        PurePath(path).stem,
        np.arange(frames) * recording.frame_time,
        translations * scale,
        Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat().reshape(frames, joints, 4),
        np.ones((frames, joints, 3)),
    )
    return Skeleton(tuple(recording.names), np.array(recording.parents), rest), clip


def _check(path: Location, recording: Recording) -> None:
    """Refuse what no player could show."""
    joints, frames = len(recording.names), len(recording.values)
    if joints > limits.JOINTS:
        message = f"has {joints} joints, at most {limits.JOINTS} are read; leave some out"
        raise FormatError(path, "HIERARCHY", message, code=Code.LIMIT_JOINTS)
    if frames > limits.FRAMES or frames * joints > limits.JOINT_FRAMES:
        message = (
            f"has {frames} frames of {joints} joints, at most {limits.FRAMES} frames and "
            f"{limits.JOINT_FRAMES} joints times frames are read; cut it into pieces"
        )
        raise FormatError(path, "MOTION", message, code=Code.LIMIT_FRAMES)
    if not (np.isfinite(recording.frame_time) and recording.frame_time > 0):
        raise FormatError(
            path,
            "Frame Time",
            f"is {recording.frame_time}; wanted seconds above 0, such as 0.0333",
            code=Code.BVH_FRAME_TIME,
        )
    wrong = ~(np.abs(recording.offsets) < limits.COORDINATE).all(axis=1)
    if wrong.any():
        name = recording.names[int(wrong.argmax())]
        raise FormatError(
            path,
            f"joint {name!r}",
            "has an OFFSET that is not finite or too large; mend it",
            code=Code.BVH_OFFSET,
        )
    wrong = ~(np.abs(recording.values) < limits.COORDINATE).all(axis=1)
    if wrong.any():
        raise FormatError(
            path,
            f"frame {int(wrong.argmax())}",
            "holds a number that is not finite or too large; cut it out",
            code=Code.BVH_MOTION,
        )


def _announce_oddities(path: Location, recording: Recording) -> None:
    """Say what other programs may trip over."""
    moving = [joint for joint, own in enumerate(recording.channels) if own]
    repeated = len(moving) - len({recording.names[joint] for joint in moving})
    roots = recording.parents.count(NO_PARENT)
    inner = set(recording.parents)
    open_ends = sum(joint not in inner for joint in moving)
    odd = (
        (repeated, "joints have a name that another joint has"),
        (roots if roots > 1 else 0, "roots; each moves by itself"),
        (open_ends, "joints end without an End Site: where they point is not known"),
    )
    for count, message in odd:
        if count:
            announce(path, f"{count} {message}", code=Code.BVH_JOINTS, where="HIERARCHY")


def _local_motion(
    path: Location, recording: Recording
) -> tuple[Float[np.ndarray, "frames joints 3"], Float[np.ndarray, "frames joints 3 3"]]:
    """Turn channels into translations, in file units, and rotations of every joint."""
    frames, joints = len(recording.values), len(recording.names)
    translations = np.broadcast_to(recording.offsets, (frames, joints, 3)).copy()
    rotations = np.broadcast_to(np.eye(3), (frames, joints, 3, 3)).copy()
    column = 0
    for joint, channels in enumerate(recording.channels):
        columns = recording.values[:, column : column + len(channels)]
        column += len(channels)
        order = "".join(channel[1] for channel in channels if channel[0] == "R")
        turning = [i for i, channel in enumerate(channels) if channel[0] == "R"]
        for i, channel in enumerate(channels):
            if channel[0] == "P":
                translations[:, joint, "XYZ".index(channel[1])] = columns[:, i]
        if order:
            try:
                turns = Rotation.from_euler(order, columns[:, turning], degrees=True)
            except ValueError:
                raise FormatError(
                    path,
                    f"joint {recording.names[joint]!r}",
                    f"turns about {order}; give each once",
                    code=Code.BVH_CHANNELS,
                ) from None
            rotations[:, joint] = turns.as_matrix()
    _add_missing_offsets(recording, translations)
    return translations, rotations


def _add_missing_offsets(
    recording: Recording, translations: Float[np.ndarray, "frames joints 3"]
) -> None:
    """Read the positions of inner joints as on top of the offset, if that is what is nearer.

    Most programs write the whole translation (so does everybody for the root), some only what
    differs from the offset, often zero.
    """
    inner = np.array(recording.parents) != NO_PARENT
    positioned = np.array([any(name[0] == "P" for name in own) for own in recording.channels])
    chosen = inner & positioned
    moved = translations[:, chosen]
    if np.abs(moved - recording.offsets[chosen]).sum() > np.abs(moved).sum():
        translations[:, chosen] += recording.offsets[chosen]


def _stands_along_z(
    recording: Recording,
    translations: Float[np.ndarray, "frames joints 3"],
    rotations: Float[np.ndarray, "frames joints 3 3"],
) -> bool:
    """Tell whether the body is tall in z rather than y, in the rest pose or else in the motion.

    The rest pose decides if it is clear, because a motion may well be that of somebody lying down;
    it is not clear where all limbs point sideways or arms are spread along z.
    """
    parents = np.array(recording.parents)
    rest = np.tile(np.eye(4), (len(parents), 1, 1))
    rest[:, :3, 3] = recording.offsets
    x, y, z = np.ptp(forward_kinematics(parents, rest)[:, :3, 3], axis=0)
    if max(y, z) > 1.3 * min(y, z) and 2 * max(y, z) > x:
        return bool(z > y)
    step = max(1, len(translations) // 100)
    local = compose_transforms(translations[::step], rotations[::step])
    places = forward_kinematics(parents, local)[..., :3, 3]
    _, y, z = np.median(np.ptp(places, axis=1), axis=0)
    return bool(z > 1.3 * y)


def _metres_per_unit(path: Location, recording: Recording) -> float:
    """Guess the unit of length from the longest way through the skeleton, about a body's height."""
    size = _longest_path(recording.parents, np.linalg.norm(recording.offsets, axis=1))
    if size <= 0:
        message = "all bones have length 0; one unit is taken as 0.01 m"
        announce(path, message, code=Code.BVH_OFFSET, where="HIERARCHY")
        return 0.01
    powers = [1.0, 0.1, 0.01, 0.001]
    unit = min(powers, key=lambda metres: abs(np.log(size * metres / 1.8)))
    if 1.4 <= size * INCH <= 2.5:
        unit = INCH
    logger.info("%s: one unit is taken as %g m", path, unit)
    if not SHORTEST_BODY <= size * unit <= TALLEST_BODY:
        logger.info("%s: the skeleton is %.3g m long", path, size * unit)
    return unit


def _longest_path(parents: Sequence[int], lengths: Float[np.ndarray, " joints"]) -> float:
    """Measure the longest way along bones between any two joints."""
    reach: Float[np.ndarray, " joints"] = np.zeros(len(parents))
    longest = 0.0
    for joint in reversed(range(len(parents))):
        parent = parents[joint]
        if parent != NO_PARENT:
            way = reach[joint] + lengths[joint]
            longest = max(longest, reach[parent] + way)
            reach[parent] = max(reach[parent], way)
    return longest

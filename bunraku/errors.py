"""Every fault of an input by its stable code, in one place; docs/errors.md is written from it."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import Enum

NOTE = (logging.INFO + logging.WARNING) // 2  # level of what is odd, but does no harm
WARNING = logging.WARNING  # level of what was repaired, or may do harm

logger = logging.getLogger(__name__)
_collected: ContextVar[list[str] | None] = ContextVar("_collected", default=None)  # of a thread


class Code(Enum):
    """What can be wrong with an input or output; names never change, meanings may be reworded.

    The same code marks an error, where nothing can be done, and a warning, where it was repaired.
    """

    INPUT = "something else is wrong with the input; the message says what"
    OPTION = "an option's value is not one of those that are possible"
    EXTRA_MISSING = "an optional package is needed: the message says how to install it"
    DATA = "evaluation data are missing, or are not what the table wants"

    FILE_MISSING = "there is no such file or folder: check its name"
    FILE_FOLDER = "a folder stands where a file was wanted, or holds nothing that could be read"
    FILE_DENIED = "permissions forbid reading the file"
    FILE_DEVICE = "a device, pipe or socket is no file"
    FILE_UNREADABLE = "the system cannot read the file, or its name cannot be a file's name"
    FILE_EMPTY = "the file has 0 bytes: download or export it again"
    FILE_KIND = "the content is of no format that is read here; it is named where it is known"

    LIMIT_BYTES = "the file is larger than what is read"
    LIMIT_VERTICES = "more vertices, or elements of one array, than are read: decimate the mesh"
    LIMIT_NODES = "more nodes than are read: flatten the scene"
    LIMIT_JOINTS = "more joints than are read"
    LIMIT_FRAMES = "more frames than are read: cut the motion into pieces"
    LIMIT_PIXELS = "a picture with more pixels than are read: scale it down"
    LIMIT_TOTAL = "all parts together are more than is read: leave some out"
    LIMIT_MEMORY = "the machine has not the memory that this takes: simplify the input"

    URI_FORBIDDEN = "a file names another one outside its own folder, or with a scheme"
    URI_MISSING = "a file that is named by another one is not beside it, or cannot be read"
    URI_DATA = "a data URI is not base64, or is damaged"

    OUT_SUFFIX = "the name of an output does not end in a suffix that can be written"
    OUT_PLACE = "an output cannot go where it should: no folder, no permission, or an input"
    OUT_FAILED = "writing failed (a full disk, for example); what was there before is untouched"

    MESH_EMPTY = "there are no vertices, no faces, too few points or no mesh that is shown"
    MESH_HEADER = "the header is incomplete, or says what no header of its format says"
    MESH_COUNT = "a header claims more, or less, than the file has: it is cut or damaged"
    MESH_NUMBER = "a word is no number where one is needed"
    MESH_NONFINITE = "coordinates are NaN, infinite or too large to compute with"
    MESH_INDEX = "a face names a vertex that does not exist"
    MESH_CORNERS = "a face has fewer than three corners, or indices are no whole triangles"
    MESH_DAMAGED = "the file breaks its format in another way"
    MESH_NO_AREA = "no face has an area: all are points or lines"
    MESH_ZERO_AREA = "some faces have no area; they move like all others, but measure nothing"
    MESH_FLAT = "the figure is a sheet without thickness"
    MESH_FEW_FACES = "so few faces hardly make a body"
    MESH_POINTS = "there are no faces: the vertices are taken as a point cloud"
    MESH_UNUSED = "vertices belong to no face; they move with their neighbours"
    MESH_DOUBLED = "faces are there more than once"
    MESH_OPEN = "edges have one face only: the surface is open"
    MESH_HALF = "the surface is cut off along a plane at one side: the other half may be missing"
    MESH_NON_MANIFOLD = "edges have three faces or more"
    MESH_TURNED = "neighbouring faces disagree on which side is outside"
    MESH_UP = "the figure seems to lie: another axis than the format's may be up"
    MESH_LEFT_OUT = "points, lines, normals or UVs are kept or left out, but not used"
    MATERIAL_MISSING = "a material or texture cannot be read; the surface alone is used"

    GLTF_CONTAINER = "the chunks of a GLB do not fit together: it is cut or damaged"
    GLTF_JSON = "the JSON of a glTF file is damaged, nested too deeply or not UTF-8"
    GLTF_SCHEMA = "a property of a glTF file is missing, or of another type than specified"
    GLTF_VERSION = "another version of glTF than 2"
    GLTF_INDEX = "an index points at something that does not exist"
    GLTF_RANGE = "a buffer view or accessor reaches beyond its bytes, or overlaps itself"
    GLTF_BUFFER = "a buffer has no bytes, or fewer than it says"
    GLTF_ACCESSOR = "an accessor is of another type than its use demands"
    GLTF_COMPRESSED = "geometry is compressed: install the decoder, or decompress it first"
    GLTF_EXTENSION = "a required extension is kept, but not understood"
    GLTF_UNSHOWN = "meshes exist that no node shows"

    NODE_TREE = "nodes have two parents, or are their own ancestors"
    NODE_TRANSFORM = "a node's transform is not finite, flattens or is no unit quaternion"

    RIG_MISSING = "there is no rig: neither a skin nor animated nodes"
    RIG_NO_SURFACE = "there is a rig, but no surface that it moves"
    RIG_VRM = "bones that a VRM names, or needs, are not there; the file may be no VRM any more"
    SKIN_JOINTS = "joints of a skin are doubled, do not exist, are not shown or share no root"
    SKIN_BIND = "inverse bind matrices are too few, not finite, flat or of different poses"
    SKIN_WEIGHTS = "skinning weights are not finite, negative, all zero or do not sum to 1"
    CLIP_MISSING = "there is no clip, or none of that name"
    CLIP_CHANNEL = "a channel moves what another one moves, or what nobody knows"
    CLIP_TIMES = "key times are not finite, do not rise, or lie outside what is read"
    CLIP_VALUES = "key values are too few, not finite or no rotations"

    BVH_HIERARCHY = "the HIERARCHY section breaks off, or its braces or keywords are wrong"
    BVH_CHANNELS = "channels are unknown, doubled or missing"
    BVH_OFFSET = "an OFFSET is missing, no number or not finite, or all bones have no length"
    BVH_MOTION = "the MOTION section is missing, or its numbers are damaged"
    BVH_COUNT = "there are fewer frames, or numbers in a frame, than the file says"
    BVH_FRAME_TIME = "the frame time is no number of seconds above 0"
    BVH_JOINTS = "joints share a name, have several roots or end without an end site"

    FBX_RECORDS = "the records or objects of an FBX file do not fit together: it is damaged"
    FBX_VERSION = "an FBX file written as text, or older than version 7: save it as binary FBX"
    FBX_LEFT_OUT = "something in an FBX file is not read: textures, blend shapes, more layers"

    DEPTH_FRAMES = "depth frames are missing, of several sizes, no 16-bit pictures, or have gaps"
    DEPTH_INTRINSICS = "the lens of a depth camera is missing, or impossible: fx, fy, cx, cy, scale"
    DEPTH_MASK = "masks of the subject are missing for some frames, or of another size"
    DEPTH_SUBJECT = "no moving subject can be told from the scene, or it is out of sight"

    AVATAR_POSED = (
        "a posed avatar has not the vertices of the avatar at rest, in its order and unit"
    )
    NETWORK = "a file of network weights is damaged, or of another network or training"

    JOBS = "a list of jobs is no table with a figure a line, or a job's options are wrong"

    LANDMARKS = "the landmarks are not places of joints of the performance"
    MATCH_POOR = "the figure cannot be matched well enough (exit code 3; --force writes anyway)"
    MATCH_DOUBTFUL = "the figure was matched, but something about the match is doubtful"


def announce(
    path: object, message: str, *, code: Code, where: str = "", level: int = WARNING
) -> None:
    """Log something odd about a file that was repaired, left out or only noticed.

    Args:
        path: the file as the user named it.
        message: what was found and what was done.
        code: which fault it is.
        where: a JSON pointer, a line, a frame; empty if the whole file is meant.
        level: NOTE or WARNING.
    """
    place = f"{where}: " if where else ""
    fault = {"code": code, "where": where, "found": message, "about": path}
    logger.log(level, "%s: %s%s", path, place, message, extra=fault)


def doubt(message: str) -> None:
    """Log what makes a match doubtful, from where no file is known; whoever calls names it."""
    collected = _collected.get()
    if collected is not None and message not in collected:
        collected.append(message)
    fault = {"code": Code.MATCH_DOUBTFUL, "where": "", "found": message, "about": None}
    logger.warning("%s", message, extra=fault)


@contextmanager
def collecting_doubts() -> Iterator[list[str]]:
    """Collect what this thread tells `doubt`, each message once, logged or not."""
    messages: list[str] = []
    token = _collected.set(messages)
    try:
        yield messages
    finally:
        _collected.reset(token)

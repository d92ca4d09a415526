"""What a file holds, and what is wrong with it."""

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bunraku.errors import NOTE, WARNING, Code, announce
from bunraku.formats import gltf
from bunraku.formats.axes import guess_up, world_from_axes
from bunraku.formats.depth_checks import check_depth
from bunraku.formats.depth_video import frame_files, is_depth_folder, read_depth
from bunraku.formats.fbx import convert_to_glb
from bunraku.formats.files import Location, read_bytes
from bunraku.formats.meshes import merge_pieces, read_pieces
from bunraku.formats.reading import read_motion
from bunraku.formats.sniffing import sniff
from bunraku.formats.surfaces import check_cloud, check_surface, measure_surface
from bunraku.skinning import forward_kinematics
from bunraku.types import FormatError, Mesh

Vector = tuple[float, float, float]
FLOOR = 0.01  # of the longest extent: so near to 0 lies the floor that a figure stands on
SEVERITIES = {NOTE: "note", WARNING: "warning"}


@dataclass(frozen=True)
class Fault:
    """Something that is odd about a file."""

    code: str  # stable, for programs: docs/errors.md
    where: str  # a JSON pointer, a line, a frame; empty if the whole file is meant
    message: str
    severity: str  # note: common and harmless; warning: repaired, or results may suffer


@dataclass(frozen=True)
class ClipSummary:
    """A clip in numbers."""

    name: str
    seconds: float
    frames: int


@dataclass(frozen=True)
class Inspection:
    """What a file holds; lengths in the file's units, or metres where it tells them."""

    path: str
    kind: str  # figure, character, motion or depth
    format: str  # gltf, obj, ply, stl, off, bvh or folder
    bytes: int
    meshes: int = 0
    pieces: int = 0  # primitives, groups or solids in the file
    vertices: int = 0
    welded_vertices: int = 0  # those at equal positions taken as one
    faces: int = 0
    parts: int = 0  # connected parts, after welding
    closed: bool = False
    boundary_edges: int = 0  # edges of one face
    non_manifold_edges: int = 0  # edges of three faces or more
    low: Vector = (0.0, 0.0, 0.0)  # smallest x, y, z, after turning upright
    high: Vector = (0.0, 0.0, 0.0)  # largest
    extent: Vector = (0.0, 0.0, 0.0)  # high - low
    up: str = "y"  # axis of the file: its format's own, or else a guess
    facing: str = "+z"  # axis of the file that the figure looks along, by custom
    materials: int = 0
    textures: int = 0
    skins: tuple[int, ...] = ()  # joints of each
    joints: int = 0
    bind: str = ""  # see gltf.description.name_bind; rest for a motion
    clips: tuple[ClipSummary, ...] = ()
    extensions_used: tuple[str, ...] = ()
    extensions_required: tuple[str, ...] = ()
    pixels: tuple[int, int] = (0, 0)  # width and height of depth frames
    view_degrees: tuple[float, float] = (0.0, 0.0)  # of the depth camera, across and along
    depth_metres: tuple[float, float] = (0.0, 0.0)  # nearest and farthest, outermost 1 % left out
    masked: bool = False  # the subject's pixels are told
    faults: tuple[Fault, ...] = ()


def inspect(path: Location) -> Inspection:
    """Read a file whole, and say what it holds.

    Raises:
        FormatError: if it cannot be read.
    """
    with _collecting_faults() as faults:
        found = _inspect(path)
    return replace(found, faults=(*dict.fromkeys(faults), *found.faults))


@contextmanager
def _collecting_faults() -> Iterator[list[Fault]]:
    """Collect what readers announce."""
    package, handler = logging.getLogger("bunraku"), _FaultHandler(NOTE)
    previous = package.level
    package.addHandler(handler)
    package.setLevel(min(package.getEffectiveLevel(), NOTE))
    try:
        yield handler.faults
    finally:
        package.setLevel(previous)
        package.removeHandler(handler)


class _FaultHandler(logging.Handler):
    """Keep announced faults in order."""

    def __init__(self, level: int) -> None:
        super().__init__(level)
        self.faults: list[Fault] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record that `announce` made."""
        fault = record.__dict__
        if isinstance(fault.get("code"), Code):
            severity = SEVERITIES.get(record.levelno, "warning")
            told = Fault(fault["code"].name, fault["where"], fault["found"], severity)
            self.faults.append(told)


def _inspect(path: Location) -> Inspection:
    """Say what a file or folder holds."""
    if os.path.isdir(path):
        return _inspect_folder(path)
    content = read_bytes(path)
    kind = sniff(path, content)
    found = Inspection(os.fspath(path), "figure", kind, len(content))
    if kind == "bvh":
        return _inspect_motion(found)
    if kind == "fbx":
        return _inspect_gltf(found, convert_to_glb(path, content))
    if kind == "gltf":
        return _inspect_gltf(found, content)
    pieces, materials = read_pieces(path, content, kind)
    del content  # a text may be larger than what is in it
    mesh = merge_pieces(pieces)
    up = guess_up(mesh, kind)
    mesh = Mesh(mesh.vertices @ world_from_axes(up).T, mesh.faces)
    images = {material.image for material in materials if material.image}
    found = replace(found, up=up, facing="+z" if up == "y" else "-y", meshes=len(pieces))
    found = replace(found, pieces=len(pieces), materials=len(materials), textures=len(images))
    return _inspect_surface(found, mesh)


def _inspect_gltf(found: Inspection, content: bytes) -> Inspection:
    """Say what a glTF file holds."""
    told = gltf.describe(found.path, content)
    mesh: Mesh | None = told["mesh"]
    if mesh is None:
        _check_library(found.path, told["joints"], len(told["clips"]))
    found = replace(
        found,
        kind="character" if told["joints"] else "figure",
        meshes=told["meshes"],
        pieces=told["primitives"],
        facing=told["facing"],
        materials=told["materials"],
        textures=told["textures"],
        skins=tuple(told["skins"]),
        joints=told["joints"],
        bind=told["bind"],
        clips=tuple(ClipSummary(*clip) for clip in told["clips"]),
        extensions_used=tuple(told["extensions_used"]),
        extensions_required=tuple(told["extensions_required"]),
    )
    if mesh is None:
        return _add_bounds(found, told["places"])
    if told["is_placeholder"]:
        message = f"the places of {len(mesh.vertices)} vertices are not stored: no shape to animate"
        announce(found.path, message, code=Code.MESH_NO_AREA, where="/meshes", level=NOTE)
        found = replace(found, vertices=len(mesh.vertices), faces=len(mesh.faces))
        return _add_bounds(found, mesh.vertices)
    _check_up(found.path, mesh)
    return _inspect_surface(found, mesh)


def _check_up(path: str, mesh: Mesh) -> None:
    """Tell that a glTF figure seems to lie, or to stand on its head, by its shape and its floor."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    near = FLOOR * (high - low).max()
    if high[1] <= near and low[1] < -near:
        message = "the whole figure is below y = 0: it may stand on its head; check"
        announce(path, message, code=Code.MESH_UP)
    elif guess_up(mesh, "gltf") != "y":
        message = "the figure may lie: by its shape, z is up; check, or give --up z"
        on_z = abs(low[2]) <= near and abs(low[1]) > near
        announce(path, message, code=Code.MESH_UP, level=WARNING if on_z else NOTE)


def _check_library(path: str, joints: int, clips: int) -> None:
    """Tell that there is no surface; refuse unless clips of a skeleton are worth a look."""
    if not joints:
        message = "shows no mesh and holds no rig; export it with its surface"
        raise FormatError(path, "/meshes", message, code=Code.MESH_EMPTY)
    if joints == 1 or not clips:
        message = (
            f"holds {joints} joints and {clips} clips, but no surface; export it with its mesh"
        )
        raise FormatError(path, "/meshes", message, code=Code.RIG_NO_SURFACE)
    message = "has a rig but no surface: nothing can be animated, or animate others, with it"
    announce(path, message, code=Code.RIG_NO_SURFACE, where="/meshes")


def _inspect_motion(found: Inspection) -> Inspection:
    """Say what a BVH holds."""
    skeleton, clip = read_motion(found.path)
    places = forward_kinematics(skeleton.parents, skeleton.rest)[:, :3, 3]
    return replace(
        _add_bounds(found, places),
        kind="motion",
        joints=len(skeleton.names),
        bind="rest",
        clips=(ClipSummary(clip.name, float(np.ptp(clip.times)), len(clip.times)),),
    )


def _inspect_folder(path: Location) -> Inspection:
    """Read a folder of depth frames whole, and say what it holds."""
    if not is_depth_folder(path):
        raise FormatError(
            path,
            "",
            "is a folder without NNNN.png frames and intrinsics.json; give a file",
            code=Code.FILE_FOLDER,
        )
    video = read_depth(path)
    check_depth(path, video)
    rows, columns = video.depths.shape[1:]
    known = video.depths > 0
    size = sum(frame.stat().st_size for frame in frame_files(Path(path)).values())
    seconds = float(video.times[-1] - video.times[0])
    focal = video.intrinsics[[0, 1], [0, 1]]
    across, along = np.degrees(2 * np.arctan(np.array([columns, rows]) / 2 / focal)).tolist()
    near, far = np.percentile(video.depths[known], [1, 99]).tolist() if known.any() else (0.0, 0.0)
    return Inspection(
        os.fspath(path),
        "depth",
        "folder",
        size,
        clips=(ClipSummary(Path(path).name, seconds, len(video.times)),),
        pixels=(columns, rows),
        view_degrees=(across, along),
        depth_metres=(near, far),
        masked=video.masks is not None,
    )


def _add_bounds(found: Inspection, points: Float[np.ndarray, "points 3"]) -> Inspection:
    """Add the box around points to an inspection."""
    low, high = points.min(axis=0), points.max(axis=0)
    return replace(found, low=_vector(low), high=_vector(high), extent=_vector(high - low))


def _vector(array: Float[np.ndarray, "3"]) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


def _inspect_surface(found: Inspection, mesh: Mesh) -> Inspection:
    """Add what the geometry shows to an inspection, and announce what is odd about it."""
    if not np.ptp(mesh.vertices, axis=0).any():
        message = "all vertices lie at one point; export it again with its shape"
        raise FormatError(found.path, "/meshes", message, code=Code.MESH_NO_AREA)
    check_cloud(found.path, mesh)
    surface = measure_surface(mesh)
    check_surface(found.path, mesh, surface)
    found = _add_bounds(found, mesh.vertices[surface.used] if len(mesh.faces) else mesh.vertices)
    return replace(
        found,
        vertices=len(mesh.vertices),
        welded_vertices=surface.welded_vertices,
        faces=len(mesh.faces),
        parts=surface.parts,
        closed=surface.is_closed,
        boundary_edges=surface.boundary_edges,
        non_manifold_edges=surface.non_manifold_edges,
    )

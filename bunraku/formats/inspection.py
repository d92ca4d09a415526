"""What a file holds, and what is wrong with it."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from bunraku.formats import gltf
from bunraku.formats.axes import guess_up, world_from_axes
from bunraku.formats.depth_video import frame_files, is_depth_folder, read_depth
from bunraku.formats.files import Location, read_bytes
from bunraku.formats.meshes import merge_pieces, read_pieces
from bunraku.formats.reading import read_motion
from bunraku.formats.sniffing import sniff
from bunraku.meshes import connected_parts, face_normals, referenced, weld
from bunraku.skinning import forward_kinematics
from bunraku.types import NO_PARENT, DepthVideo, FormatError, Mesh

NOTE, WARNING = "note", "warning"

FLAT = 1e-4  # thickness of a sheet, as a share of the longest extent
FEW_FACES = 100


@dataclass(frozen=True)
class Fault:
    """Something that is odd about a file."""

    code: str  # stable, for programs
    where: str
    message: str
    severity: str  # note: common and harmless; warning: results may suffer


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
    vertices: int = 0
    faces: int = 0
    pieces: int = 0  # meshes or groups in the file
    parts: int = 0  # connected parts, vertices at equal positions taken as one
    closed: bool = False
    boundary_edges: int = 0  # edges of one face
    non_manifold_edges: int = 0  # edges of three faces or more
    extent: tuple[float, float, float] = (0.0, 0.0, 0.0)  # x, y, z, after turning upright
    up: str = "y"  # axis of the file
    materials: int = 0
    textures: int = 0
    skins: tuple[int, ...] = ()  # joints of each
    joints: int = 0
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
    if os.path.isdir(path):
        return _inspect_folder(path)
    content = read_bytes(path)
    kind = sniff(path, content)
    found = Inspection(os.fspath(path), "figure", kind, len(content))
    if kind == "bvh":
        return _inspect_motion(found)
    if kind == "gltf":
        return _inspect_gltf(found, content)
    pieces, materials = read_pieces(path, content, kind)
    mesh = merge_pieces(pieces)
    up = guess_up(mesh, kind)
    mesh = Mesh(mesh.vertices @ world_from_axes(up).T, mesh.faces)
    images = {material.image for material in materials if material.image}
    found = replace(found, up=up, pieces=len(pieces))
    found = replace(found, materials=len(materials), textures=len(images))
    return _inspect_surface(found, mesh)


def _inspect_gltf(found: Inspection, content: bytes) -> Inspection:
    """Say what a glTF file holds."""
    told = gltf.describe(found.path, content)
    if not told["vertices"] and not told["joints"]:
        raise FormatError(found.path, "", "shows no mesh and holds no rig; export it with geometry")
    found = replace(
        found,
        kind="character" if told["joints"] else "figure",
        pieces=told["primitives"],
        materials=told["materials"],
        textures=told["textures"],
        skins=tuple(told["skins"]),
        joints=told["joints"],
        clips=tuple(ClipSummary(*clip) for clip in told["clips"]),
        extensions_used=tuple(told["extensions_used"]),
        extensions_required=tuple(told["extensions_required"]),
        faults=tuple(Fault("repaired", "", text, WARNING) for text in told["warnings"]),
    )
    if not told["vertices"]:
        return found
    return _inspect_surface(found, gltf.read_figure(found.path, content).mesh)


def _inspect_motion(found: Inspection) -> Inspection:
    """Say what a BVH holds."""
    skeleton, clip = read_motion(found.path)
    places = forward_kinematics(skeleton.parents, skeleton.rest)[:, :3, 3]
    repeated = len(skeleton.names) - len(set(skeleton.names))
    faults = found.faults
    if repeated:
        faults += (Fault("repeated-names", "", f"{repeated} joints share a name", NOTE),)
    if (skeleton.parents == NO_PARENT).sum() > 1:
        faults += (Fault("several-roots", "", "has more than one root", NOTE),)
    return replace(
        found,
        kind="motion",
        joints=len(skeleton.names),
        extent=_extent(places),
        clips=(ClipSummary(clip.name, float(np.ptp(clip.times)), len(clip.times)),),
        faults=faults,
    )


def _inspect_folder(path: Location) -> Inspection:
    """Read a folder of depth frames whole, and say what it holds."""
    if not is_depth_folder(path):
        raise FormatError(
            path, "", "is a folder without NNNN.png frames and intrinsics.json; give a file"
        )
    video = read_depth(path)
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
        faults=tuple(_find_depth_faults(video)),
    )


def _find_depth_faults(video: DepthVideo) -> Iterator[Fault]:
    """List what is odd about a depth video."""
    empty = ~(video.depths > 0).any(axis=(1, 2))
    steps = np.diff(video.times)
    gaps = int((steps > 1.5 * np.median(steps)).sum()) if len(steps) else 0
    unseen = 0 if video.masks is None else int((~video.masks.any(axis=(1, 2))).sum())
    odd = (
        ("one-frame", int(len(video.times) < 2), "frame alone: no motion can be read", WARNING),
        ("empty-frames", int(empty.sum()), "frames measured nothing", WARNING),
        ("empty-masks", unseen, "masks are empty: the subject is out of sight", WARNING),
        ("gaps", gaps, "gaps in the numbering: taken as pauses", NOTE),
        (
            "far",
            int((video.depths > 20).any()),
            "depth beyond 20 m: is depth_scale right?",
            WARNING,
        ),
    )
    for code, count, message, severity in odd:
        if count:
            yield Fault(code, "", f"{count} {message}", severity)


def _extent(points: Float[np.ndarray, "points 3"]) -> tuple[float, float, float]:
    """Give the size of the box around points."""
    x, y, z = np.ptp(points, axis=0).tolist()
    return x, y, z


def _inspect_surface(found: Inspection, mesh: Mesh) -> Inspection:
    """Add what the geometry shows to an inspection, and its faults."""
    _, faces, welded_of = weld(mesh.vertices, mesh.faces)
    used = referenced(mesh.faces, len(mesh.vertices))
    edges = _count_edges(faces)
    parts = connected_parts(faces, int(welded_of.max()) + 1)
    found = replace(
        found,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        parts=len(np.unique(parts[welded_of[used]])),
        closed=bool(len(faces)) and not any(edges.values()),
        boundary_edges=edges["boundary"],
        non_manifold_edges=edges["non-manifold"],
        extent=_extent(mesh.vertices[used] if used.any() else mesh.vertices),
    )
    return replace(found, faults=found.faults + tuple(_find_faults(found, mesh, used, edges)))


def _count_edges(faces: Int[np.ndarray, "faces 3"]) -> dict[str, int]:
    """Count the edges that a closed, evenly turned surface does not have."""
    starts, ends = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    count = int(faces.max(initial=0)) + 1
    undirected = np.minimum(starts, ends) * count + np.maximum(starts, ends)
    _, times = np.unique(undirected, return_counts=True)
    _, again = np.unique(starts * count + ends, return_counts=True)
    crowded = int((times > 2).sum())
    return {
        "boundary": int((times == 1).sum()),
        "non-manifold": crowded,
        "turned": int((again > 1).sum()) if not crowded else 0,
    }


def _find_faults(
    found: Inspection,
    mesh: Mesh,
    used: Bool[np.ndarray, " vertices"],
    edges: dict[str, int],
) -> Iterator[Fault]:
    """List what is odd about a surface."""
    if not len(mesh.faces):
        yield Fault("no-faces", "", "has no faces: it is taken as a point cloud", WARNING)
        return
    corners = mesh.vertices / (np.abs(mesh.vertices[used]).max() or 1.0)
    areas = np.linalg.norm(face_normals(corners, mesh.faces), axis=1)
    doubled = len(mesh.faces) - len(np.unique(np.sort(mesh.faces, axis=1), axis=0))
    flat = min(found.extent) < FLAT * max(found.extent)
    odd = (
        ("zero-area", int((areas <= 1e-14).sum()), "faces have no area", WARNING),
        ("flat", int(flat), "sheet: the figure has no thickness", WARNING),
        ("few-faces", len(mesh.faces) * (len(mesh.faces) < FEW_FACES), "faces are few", NOTE),
        ("unused-vertices", int((~used).sum()), "vertices belong to no face", NOTE),
        ("doubled-faces", doubled, "faces are there more than once", NOTE),
        ("open", edges["boundary"], "edges have one face only: the surface is open", NOTE),
        ("non-manifold", edges["non-manifold"], "edges have three faces or more", NOTE),
        ("turned-faces", edges["turned"], "edges have faces that disagree on the outside", NOTE),
    )
    for code, count, message, severity in odd:
        if count:
            yield Fault(code, "", f"{count} {message}", severity)

"""What the surface of a figure is like, counted: welded vertices, parts, edges; and what is odd."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from bunraku.errors import NOTE, WARNING, Code, announce
from bunraku.formats.files import Location
from bunraku.meshes import connected_parts, face_normals, referenced, weld
from bunraku.types import FormatError, Mesh

FLAT = 1e-4  # thickness of a sheet, as a share of the longest extent
FEW_FACES = 100
FEW_POINTS = 100  # of a cloud
FEWEST_CUT = 12  # edges along which a half is cut off
CUT = 1e-3  # of the width: so flat is a cut
NO_AREA = 1e-14  # twice a face's area, as a share of the largest coordinate squared


@dataclass(frozen=True, eq=False)
class Surface:
    """A mesh in numbers, vertices at equal positions taken as one."""

    welded_vertices: int
    parts: int
    used: Bool[np.ndarray, " vertices"]  # by a face
    boundary_edges: int  # of one face
    non_manifold_edges: int  # of three faces or more
    turned_edges: int  # whose faces disagree on the outside; 0 if some edges are not manifold

    @property
    def is_closed(self) -> bool:
        """Tell whether every edge has two faces that agree on the outside."""
        odd = self.boundary_edges or self.non_manifold_edges or self.turned_edges
        return bool(self.used.any()) and not odd


def measure_surface(mesh: Mesh) -> Surface:
    """Count what there is of a surface."""
    welded, faces, welded_of = weld(mesh.vertices, mesh.faces)
    used = referenced(mesh.faces, len(mesh.vertices))
    parts = connected_parts(faces, len(welded))
    seen = np.zeros(len(welded), bool)
    seen[welded_of[used]] = True
    return Surface(len(welded), len(np.unique(parts[seen])), used, *_count_edges(faces))


def _count_edges(faces: Int[np.ndarray, "faces 3"]) -> tuple[int, int, int]:
    """Count the edges that a closed, evenly turned surface does not have."""
    starts, ends = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    count = int(faces.max(initial=0)) + 1
    times = _multiplicities(np.minimum(starts, ends) * count + np.maximum(starts, ends))
    crowded = int((times > 2).sum())
    again = 0 if crowded else int((_multiplicities(starts * count + ends) > 1).sum())
    return int((times == 1).sum()), crowded, again


def _multiplicities(keys: Int[np.ndarray, " keys"]) -> Int[np.ndarray, " different"]:
    """Count how often each key is there."""
    ordered = np.sort(keys)
    borders = np.flatnonzero(np.diff(ordered)) + 1
    return np.diff(np.concatenate([[0], borders, [len(keys)]])) if len(keys) else keys


def check_cloud(path: Location, mesh: Mesh) -> None:
    """Refuse points without faces that are too few, or too flat, to show a body.

    Raises:
        FormatError: if fewer than FEW_POINTS differ, or all lie in one plane of the axes.
    """
    if len(mesh.faces):
        return
    count, extent = len(np.unique(mesh.vertices, axis=0)), np.ptp(mesh.vertices, axis=0)
    message = ""
    if count < FEW_POINTS:
        message = f"has no faces, and {count} points are too few for a cloud of a body"
    elif extent.min() < FLAT * extent.max():
        message = f"has no faces, and its {count} points lie in a plane: no body"
    if message:
        raise FormatError(path, "", f"{message}; export it as a mesh", code=Code.MESH_EMPTY)


def check_surface(path: Location, mesh: Mesh, surface: Surface) -> None:
    """Announce what is odd about a surface."""
    if not len(mesh.faces):
        return  # the reader said so
    corners = mesh.vertices / (np.abs(mesh.vertices[surface.used]).max() or 1.0)
    areas = np.linalg.norm(face_normals(corners, mesh.faces), axis=1)
    extent = np.ptp(mesh.vertices[surface.used], axis=0)
    count, empty = len(mesh.faces), int((areas <= NO_AREA).sum())
    if empty == count:
        announce(path, "no face has an area: it cannot be animated", code=Code.MESH_NO_AREA)
    if count >= FEW_FACES and _is_half(mesh, surface):
        message = "is open along a plane at one side: a half? apply the mirror, and export again"
        announce(path, message, code=Code.MESH_HALF)
    flat = int(extent.min() < FLAT * extent.max())
    is_crushed = count >= FEW_FACES and flat and extent.min() > 0
    odd = (
        (Code.MESH_ZERO_AREA, empty * (empty < count), "faces have no area", WARNING),
        (
            Code.MESH_FLAT,
            flat,
            "sheet: the figure has no thickness",
            WARNING if is_crushed else NOTE,
        ),
        (Code.MESH_FEW_FACES, count * (count < FEW_FACES), "faces are few", NOTE),
        (Code.MESH_UNUSED, int((~surface.used).sum()), "vertices belong to no face", NOTE),
        (Code.MESH_DOUBLED, _count_doubled(mesh.faces), "faces are there more than once", NOTE),
        (Code.MESH_OPEN, surface.boundary_edges, "edges have one face only: it is open", NOTE),
        (
            Code.MESH_NON_MANIFOLD,
            surface.non_manifold_edges,
            "edges have three faces or more",
            NOTE,
        ),
        (
            Code.MESH_TURNED,
            surface.turned_edges,
            "edges have faces that disagree on the outside",
            NOTE,
        ),
    )
    for code, times, message, level in odd:
        if times:
            announce(path, f"{times} {message}", code=code, level=level)


def _is_half(mesh: Mesh, surface: Surface) -> bool:
    """Tell whether a surface is open along one side only, in a plane: a half to be mirrored."""
    if surface.boundary_edges < FEWEST_CUT or surface.non_manifold_edges:
        return False
    across = mesh.vertices[:, 0]
    for side in (across.min(), across.max()):
        near = np.abs(across - side) <= CUT * np.ptp(across)
        beside = mesh.faces[near[mesh.faces].sum(axis=1) > 1]  # only these can have an edge there
        if not len(beside):
            continue
        used, corners = np.unique(beside, return_inverse=True)
        _, faces, welded_of = weld(mesh.vertices[used], corners.reshape(-1, 3))
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        in_plane = np.zeros(len(used), bool)
        in_plane[welded_of] = near[used]
        edges = edges[in_plane[edges].all(axis=1)]
        times = _multiplicities(edges[:, 0] * len(used) + edges[:, 1])
        if (times == 1).sum() > 0.9 * surface.boundary_edges:
            return True
    return False


def _count_doubled(faces: Int[np.ndarray, "faces 3"]) -> int:
    """Count faces whose three vertices another face has, in any order."""
    ordered = np.sort(faces, axis=1)
    rows = ordered[np.lexsort(ordered.T[::-1])]
    return int((rows[1:] == rows[:-1]).all(axis=1).sum())

"""Draw shaded figures without a display, by casting rays (Embree, through libigl).

picture = draw(vertices, faces, colours, camera)
sheet = arrange([[picture, picture], [picture, picture]])

Colours are linear in sRGB bytes, good enough to look at; nothing here is measured.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from igl.embree import line_mesh_intersection
from jaxtyping import Bool, Float, Int, UInt8
from PIL import Image, ImageDraw, ImageFont

from bunraku.meshes import interpolate, vertex_normals
from bunraku.rotations import vectors_to_matrices

PAPER = np.array([246.0, 244.0, 240.0])
CLAY = np.array([206.0, 196.0, 182.0])
LIGHT = np.array([0.45, 0.8, 0.6]) / np.linalg.norm([0.45, 0.8, 0.6])
SKY, KEY, SHADE = 0.42, 0.62, 0.16  # brightness from everywhere, from the light, in its shadow
FAR = 10.0  # where rays begin, in heights of the picture
OVERSAMPLE = 2
Picture = UInt8[np.ndarray, "rows columns 3"]


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel view of a box around the origin of the ground."""

    centre: Float[np.ndarray, "3"]  # what is in the middle of the picture, metres
    height: float  # of the picture, metres
    size: tuple[int, int] = (180, 240)  # width and height, pixels
    turn: float = 0.5  # about Y: how far to the figure's left we stand, radians
    tilt: float = 0.12  # how far we look down, radians

    @property
    def world_from_camera(self) -> Float[np.ndarray, "3 3"]:
        """Give the camera's axes: right, up, and out of the picture towards us."""
        turn, tilt = vectors_to_matrices(np.array([[0.0, self.turn, 0.0], [-self.tilt, 0.0, 0.0]]))
        return turn @ tilt


def look_at(
    moved: Float[np.ndarray, "frames vertices 3"], size: tuple[int, int] = (180, 240)
) -> Camera:
    """Place a camera so that every frame is in the picture."""
    camera = Camera(np.zeros(3), 1.0, size)
    seen = moved.reshape(-1, 3) @ camera.world_from_camera
    low, high = seen.min(axis=0), seen.max(axis=0)
    width, height = (high - low)[:2]
    fitting = 1.12 * max(height, width * size[1] / size[0])
    return Camera(camera.world_from_camera @ ((low + high) / 2), fitting, size)


def draw(
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    colours: Float[np.ndarray, "vertices 3"],
    camera: Camera,
    *,
    floor: float = 0.0,
) -> Picture:
    """Draw a figure on a floor with one light and its shadow.

    Args:
        colours: red, green and blue of each vertex, 0 to 255.
        floor: height of the ground, in metres.
    """
    width, height = (OVERSAMPLE * side for side in camera.size)
    axes = camera.world_from_camera
    origins = _pixel_places(camera, width, height)
    far = FAR * camera.height
    face, shares = cast_rays(origins + far * axes[:, 2], -axes[:, 2], vertices, faces)
    hit = face >= 0
    shown = np.empty((len(face), 3))
    corners = faces[face[hit]]
    normals = interpolate(vertex_normals(vertices, faces), corners, shares[hit])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    normals *= np.where(normals @ axes[:, 2] < 0, -1.0, 1.0)[:, None]
    places = interpolate(vertices, corners, shares[hit])
    lit = in_light(places, vertices, faces, reach=far) * np.clip(normals @ LIGHT, 0, None)
    brightness = SKY * (0.8 + 0.2 * normals[:, 1]) + KEY * lit
    shown[hit] = interpolate(colours, corners, shares[hit]) * brightness[:, None]
    down = (origins[~hit, 1] - floor) / axes[1, 2]
    ground = origins[~hit] - down[:, None] * axes[:, 2]
    dark = ~in_light(ground, vertices, faces, reach=far)
    shown[~hit] = PAPER * (1 - SHADE * dark)[:, None]
    return _shrink(shown.reshape(height, width, 3))


def _pixel_places(camera: Camera, width: int, height: int) -> Float[np.ndarray, "pixels 3"]:
    """Give the middle of each pixel on the plane through the camera's centre, row by row."""
    metres = camera.height / height
    across = (np.arange(width) + 0.5 - width / 2) * metres
    upwards = (height / 2 - np.arange(height) - 0.5) * metres
    right, up = np.meshgrid(across, upwards)
    axes = camera.world_from_camera
    return camera.centre + right.reshape(-1, 1) * axes[:, 0] + up.reshape(-1, 1) * axes[:, 1]


def cast_rays(
    origins: Float[np.ndarray, "rays 3"],
    direction: Float[np.ndarray, "3"],
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
) -> tuple[Int[np.ndarray, " rays"], Float[np.ndarray, "rays 3"]]:
    """Find where parallel rays from outside a mesh first meet it.

    Returns:
        the face, -1 if none, and barycentric coordinates in it.
    """
    directions = np.broadcast_to(direction, origins.shape)
    hits = line_mesh_intersection(
        *(np.asfortranarray(points) for points in (origins, directions, vertices)), faces
    )
    shares = np.column_stack([1 - hits[:, 1] - hits[:, 2], hits[:, 1:]])
    return hits[:, 0].astype(np.int64), shares


def in_light(
    places: Float[np.ndarray, "places 3"],
    vertices: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    *,
    reach: float,
) -> Bool[np.ndarray, " places"]:
    """Tell which places nothing keeps from the light.

    Args:
        reach: where rays begin: farther from the places than any of the mesh, in metres.
    """
    face, shares = cast_rays(places + reach * LIGHT, -LIGHT, vertices, faces)
    met = interpolate(vertices, faces[np.maximum(face, 0)], shares)
    above = (met - places) @ LIGHT > 1e-3 * reach
    return np.asarray((face < 0) | ~above)


def _shrink(shown: Float[np.ndarray, "rows columns 3"]) -> UInt8[np.ndarray, "small narrow 3"]:
    """Average blocks of pixels, so that edges are smooth."""
    rows, columns = (side // OVERSAMPLE for side in shown.shape[:2])
    blocks = shown.reshape(rows, OVERSAMPLE, columns, OVERSAMPLE, 3).mean(axis=(1, 3))
    return np.clip(blocks, 0, 255).astype(np.uint8)


def arrange(rows: Sequence[Sequence[Picture]], labels: Sequence[str] = ()) -> Image.Image:
    """Set pictures of one size in rows, with a label in the corner of each row."""
    sheet = Image.fromarray(np.vstack([np.hstack(row) for row in rows]))
    pen, height = ImageDraw.Draw(sheet), len(rows[0][0])
    for i, label in enumerate(labels):
        pen.text((8, 6 + i * height), label, fill=(90, 86, 80), font=ImageFont.load_default(13))
    return sheet

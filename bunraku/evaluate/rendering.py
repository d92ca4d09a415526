"""Film an animated character with a depth camera that errs as real ones do; truth is known.

The z-buffer is Embree's, through libigl. Noise after Nguyen, Izadi, Lovell 2012, "Modeling Kinect
sensor noise for improved 3D reconstruction and tracking" (axial part), with lost pixels at edges
and grazing angles.
"""

from dataclasses import dataclass

import numpy as np
from igl.embree import line_mesh_intersection
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt

from bunraku.depth.projection import pixel_rays, project_points
from bunraku.evaluate.families import play_at
from bunraku.meshes import face_normals, interpolate
from bunraku.rotations import vectors_to_matrices
from bunraku.types import Character, Clip, DepthVideo

Points = Float[np.ndarray, "vertices 3"]
Depth = Float[np.ndarray, "rows columns"]
VIEWS = {"front": 0.0, "threequarter": 40.0, "side": 90.0}  # degrees about the vertical
SIZE, FOCAL = (640, 480), 525.0
DISTANCE, ELEVATION = 2.2, 15.0  # of a subject of diagonal 2; degrees


@dataclass(frozen=True)
class Sensor:
    """How a depth camera errs; zero everywhere for one that does not."""

    lateral: float = 0.5  # pixels, standard deviation
    axial: tuple[float, float] = (0.0012, 0.0019)  # metres: s = a + b (z - .4)^2
    step: float = 0.001  # metres, of the numbers it writes
    grazing: float = 0.15  # cosine of view and normal, below which pixels are lost
    lost: float = 0.003  # share of pixels lost at random


def default_intrinsics() -> Float[np.ndarray, "3 3"]:
    """Give the matrix K of the camera of the tables."""
    width, height = SIZE
    return np.array([[FOCAL, 0, (width - 1) / 2], [0, FOCAL, (height - 1) / 2], [0, 0, 1.0]])


def view_from(
    places: Float[np.ndarray, "frames vertices 3"], turn: float, *, elevation: float = ELEVATION
) -> tuple[Float[np.ndarray, "frames vertices 3"], float]:
    """Bring a moving subject before a camera that looks along -Z: diagonal 2, in sight throughout.

    Args:
        places: the subject, Y up.
        turn: degrees about the vertical by which the camera stands to its left.
        elevation: degrees by which the camera looks down.

    Returns:
        the places in the camera's frame (Y up, Z towards the camera), and their scale.
    """
    scale = 2.0 / float(np.linalg.norm(np.ptp(places[0], axis=0)))
    low, high = places.min(axis=(0, 1)), places.max(axis=(0, 1))
    tilt, about = vectors_to_matrices(np.radians([[elevation, 0.0, 0.0], [0.0, -turn, 0.0]]))
    seen = scale * (places - (low + high) / 2) @ (tilt @ about).T
    away = DISTANCE
    half = np.array([SIZE[0], SIZE[1]]) / 2 - 12  # pixels left and right, above and below
    for axis in range(2):
        needed = FOCAL * np.abs(seen[..., axis]) / half[axis] + seen[..., 2]
        away = max(away, float(needed.max()))
    return seen - [0.0, 0.0, away], scale


def render_depth(
    places: Points,
    faces: Int[np.ndarray, "faces 3"],
    intrinsics: Float[np.ndarray, "3 3"],
    size: tuple[int, int] = SIZE,
) -> tuple[Depth, Int[np.ndarray, "rows columns"], Float[np.ndarray, "rows columns 3"]]:
    """Render a mesh in the camera's frame without error.

    Returns:
        depth in metres (0 for nothing), the face seen (-1 for none) and barycentric coordinates.
    """
    width, height = size
    depth, face = np.zeros((height, width)), np.full((height, width), -1, np.int64)
    shares = np.zeros((height, width, 3))
    pixels = project_points(places, intrinsics)
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - 1, 0, [width, height])
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + 2, 0, [width, height])
    rows, columns = slice(low[1], high[1]), slice(low[0], high[0])
    rays = pixel_rays(size, intrinsics)[rows, columns]
    if not rays.size:
        return depth, face, shares
    flat = np.asfortranarray(rays.reshape(-1, 3))
    hits = line_mesh_intersection(
        np.asfortranarray(np.zeros_like(flat)), flat, np.asfortranarray(places), faces
    )
    met = hits[:, 0].astype(np.int64)
    parts = np.column_stack([1 - hits[:, 1] - hits[:, 2], hits[:, 1:]])
    found = met >= 0
    parts[~found] = 0.0
    away = np.zeros(len(met))
    away[found] = -interpolate(places, faces[met[found]], parts[found])[:, 2]
    block = rays.shape[:2]
    depth[rows, columns], face[rows, columns] = away.reshape(block), met.reshape(block)
    shares[rows, columns] = parts.reshape(*block, 3)
    return depth, face, shares


def spoil_depth(
    depth: Depth,
    cosine: Depth,
    sensor: Sensor,
    rng: np.random.Generator,
) -> Depth:
    """Add a sensor's errors to a depth picture.

    Args:
        depth: metres, 0 for nothing.
        cosine: of the angle between each pixel's ray and the surface it meets.
    """
    rows, columns = np.indices(depth.shape)
    jitter = np.rint(rng.normal(0.0, sensor.lateral, (2, *depth.shape))).astype(int)
    from_row = np.clip(rows + jitter[0], 0, depth.shape[0] - 1)
    from_column = np.clip(columns + jitter[1], 0, depth.shape[1] - 1)
    seen = depth[from_row, from_column]
    spread = sensor.axial[0] + sensor.axial[1] * (seen - 0.4) ** 2
    noisy = seen + spread * rng.standard_normal(depth.shape)
    if sensor.step > 0:
        noisy = np.rint(noisy / sensor.step) * sensor.step
    kept = (seen > 0) & (cosine[from_row, from_column] > sensor.grazing)
    kept &= rng.random(depth.shape) >= sensor.lost
    return np.where(kept, noisy, 0.0)


def ray_cosines(
    places: Points,
    faces: Int[np.ndarray, "faces 3"],
    face: Int[np.ndarray, "rows columns"],
    intrinsics: Float[np.ndarray, "3 3"],
) -> Depth:
    """Give the cosine between each pixel's ray and the normal of the face it meets."""
    rays = pixel_rays((face.shape[1], face.shape[0]), intrinsics)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    normals = face_normals(places, faces)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return np.abs(np.einsum("rca,rca->rc", rays, normals[face])) * (face >= 0)


def vertex_visibility(
    places: Points, depth: Depth, intrinsics: Float[np.ndarray, "3 3"], *, slack: float = 0.02
) -> Bool[np.ndarray, " vertices"]:
    """Tell which vertices a perfect depth picture shows: no farther than it, up to `slack`."""
    pixels = np.rint(project_points(places, intrinsics)).astype(int)
    inside = ((pixels >= 0) & (pixels < depth.shape[::-1])).all(axis=1)
    seen = depth[np.where(inside, pixels[:, 1], 0), np.where(inside, pixels[:, 0], 0)]
    return np.asarray(inside & (seen > 0) & (-places[:, 2] < seen + slack))


@dataclass(frozen=True, eq=False)
class Film:
    """A character filmed by a depth camera, and what truly happened, in the camera's frame."""

    video: DepthVideo
    places: Float[np.ndarray, "frames vertices 3"]
    faces: Int[np.ndarray, "faces 3"]


def film_character(
    character: Character,
    clip: Clip,
    *,
    turn: float,
    most_frames: int = 45,
    fps: float = 30.0,
    sensor: Sensor | None = None,
) -> Film:
    """Film the beginning of a clip.

    Args:
        turn: degrees about the vertical by which the camera stands to the subject's left.
        most_frames: longer clips are cut.
        sensor: how the camera errs; None for the camera of the tables.
    """
    phases = filmed_phases(clip, most_frames, fps)
    places, _ = view_from(play_at(character, clip, phases), turn)
    intrinsics, rng = default_intrinsics(), np.random.default_rng(0)
    depths = []
    for place in places:
        depth, face, _ = render_depth(place, character.mesh.faces, intrinsics)
        cosine = ray_cosines(place, character.mesh.faces, face, intrinsics)
        depths.append(spoil_depth(depth, cosine, sensor or Sensor(), rng).astype(np.float32))
    video = DepthVideo(clip.name, np.arange(len(places)) / fps, np.stack(depths), intrinsics)
    return Film(video, places, character.mesh.faces)


def filmed_phases(clip: Clip, most_frames: int = 45, fps: float = 30.0) -> Float[np.ndarray, " n"]:
    """Give the moments of a clip that are filmed, as shares of its length: its beginning."""
    length = float(clip.times[-1] - clip.times[0])
    count = max(2, min(most_frames, int(length * fps) + 1))
    return np.minimum(np.arange(count) / fps, length) / max(length, 1e-9)


def true_paths(
    film: Film, frame: int, pixels: Int[np.ndarray, "vertices 2"]
) -> Float[np.ndarray, "frames vertices 3"]:
    """Follow the surface points that pixels of one frame show through all frames, truly.

    Args:
        pixels: row and column each; one beside the subject stands for the nearest on it.
    """
    _, face, shares = render_depth(film.places[frame], film.faces, film.video.intrinsics)
    nearest = distance_transform_edt(face < 0, return_distances=False, return_indices=True)
    rows, columns = nearest[:, pixels[:, 0], pixels[:, 1]]
    corners, share = film.faces[face[rows, columns]], shares[rows, columns]
    return np.stack([interpolate(places, corners, share) for places in film.places])

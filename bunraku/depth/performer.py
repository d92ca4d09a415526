"""What a depth video shows of its subject, and the rigged performer made of it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bunraku.bones import Bones
from bunraku.depth.meshing import View, mesh_frame
from bunraku.depth.projection import back_project
from bunraku.depth.segmentation import find_subject
from bunraku.rotations import compose_transforms, matrices_to_quaternions
from bunraku.skinning import local_transforms
from bunraku.types import Character, Clip, DepthVideo, Mesh, Skeleton, Skin

CLIP = "capture"
FEWEST_VERTICES = 100  # of a view that can be followed


@dataclass(frozen=True, eq=False)
class Subject:
    """The views of a subject, in the frames in which it was seen."""

    views: tuple[View, ...]
    times: Float[np.ndarray, " frames"]
    diagonal: float  # of its box in an average frame, metres
    warnings: tuple[str, ...]


def view_subject(video: DepthVideo) -> Subject:
    """Find the subject in every frame and mesh what is seen of it.

    Raises:
        ValueError: if no frame shows a subject, or only one does.
    """
    masks = find_subject(video)
    shown = [frame for frame, mask in enumerate(masks) if mask.any()]
    if not shown:
        raise ValueError(
            "shows no subject: no piece of 200 pixels or more stands before the scene; "
            "give mask/NNNN.png, or record nearer"
        )
    sizes = [box_diagonal(video, masks, frame) for frame in shown]
    diagonal = float(np.median(sizes))
    views, times, lost = [], [], len(masks) - len(shown)
    for frame in shown:
        view = mesh_frame(video.depths[frame], masks[frame], video.intrinsics, diagonal)
        if len(view.vertices) < FEWEST_VERTICES:
            lost += 1
            continue
        views.append(view)
        times.append(float(video.times[frame]))
    if len(views) < 2:
        raise ValueError(
            f"shows its subject in {len(views)} of {len(masks)} frames; a motion needs at least "
            "two: record more frames"
        )
    bridged = f"the subject is out of sight in {lost} of {len(masks)} frames: bridged"
    warnings = (bridged,) if lost else ()
    return Subject(tuple(views), np.array(times) - times[0], diagonal, warnings)


def box_diagonal(video: DepthVideo, masks: np.ndarray, frame: int) -> float:
    """Measure the box around the subject's points, without the outermost ones."""
    points = back_project(video.depths[frame].astype(np.float64), video.intrinsics)[masks[frame]]
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    return float(np.linalg.norm(high - low))


def build_performer(
    rest: Float[np.ndarray, "vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    bones: Bones,
    weights: Float[np.ndarray, "vertices bones"],
    motion: tuple[Float[np.ndarray, "frames bones 3 3"], Float[np.ndarray, "frames bones 3"]],
    times: Float[np.ndarray, " frames"],
) -> Character:
    """Make a character of a tracked surface; joint frames lie as the world's at rest.

    Args:
        motion: world rotation of each bone since rest, and the place of its joint.
    """
    bind = compose_transforms(bones.joints, np.tile(np.eye(3), (len(bones.joints), 1, 1)))
    names = tuple(f"bone{index:02d}" for index in range(len(bones.joints)))
    skeleton = Skeleton(names, bones.parents, local_transforms(bones.parents, bind))
    clip = make_clip(motion, bones.parents, times)
    skin = Skin(weights, np.linalg.inv(bind))
    return Character(Mesh(rest, faces), skeleton, skin, (clip,))


def make_clip(
    motion: tuple[Float[np.ndarray, "frames bones 3 3"], Float[np.ndarray, "frames bones 3"]],
    parents: Int[np.ndarray, " bones"],
    times: Float[np.ndarray, " frames"],
) -> Clip:
    """Write the bones' motion as a clip, parent_from_joint."""
    rotations, joints = motion
    local = local_transforms(parents, compose_transforms(joints, rotations))
    quaternions = matrices_to_quaternions(local[..., :3, :3])
    same = np.einsum("fjc,fjc->fj", quaternions[1:], quaternions[:-1]) >= 0
    quaternions[1:] *= np.cumprod(np.where(same, 1.0, -1.0), axis=0)[:, :, None]
    translations = local[..., :3, 3].copy()
    return Clip(CLIP, times, translations, quaternions, np.ones_like(translations))


def standing_place(rest: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "3"]:
    """Give the point of the ground under the middle of a surface."""
    low, high = np.percentile(rest, [1, 99], axis=0)
    middle = (low + high) / 2
    return np.array([middle[0], float(rest[:, 1].min()), middle[2]])

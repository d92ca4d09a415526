"""What a depth video shows of its subject: one view a frame."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bunraku.depth.meshing import View, mesh_frame
from bunraku.depth.projection import back_project
from bunraku.depth.segmentation import find_subject
from bunraku.types import DepthVideo

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

"""Turn a depth video into a rigged performer ([T4D] Maheshwari et al. 2023, "Transfer4D")."""

import logging
import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from threadpoolctl import threadpool_limits

from bunraku.bones.decomposition import decompose, fit_weights, joint_paths, neighbourhood
from bunraku.bones.performer import build_performer, standing_place, track_doubts
from bunraku.bones.splitting import Bones, make_bones, merge_bones, split_curves
from bunraku.curves import CurveSkeleton, extract_curves
from bunraku.depth.meshing import View
from bunraku.depth.subject import view_subject
from bunraku.registration.tracking import Progress, Settings, Track, choose_reference, track
from bunraku.routes.timing import Stopwatch
from bunraku.types import Character, DepthVideo

logger = logging.getLogger(__name__)
SAMPLES = 1500  # vertices that bone motions are fitted to


@dataclass(frozen=True, eq=False)
class Capture:
    """Every stage of what a depth video gave, in metres and the camera's frame."""

    views: tuple[View, ...]  # of the frames in which the subject was seen
    times: Float[np.ndarray, " frames"]
    diagonal: float
    intrinsics: Float[np.ndarray, "3 3"]  # pixels_from_camera
    track: Track
    curves: CurveSkeleton
    bones: Bones
    character: Character  # the seen side of the subject, with skeleton, skin and one clip
    eye: Float[np.ndarray, "3"]  # where the camera is in the character's frame
    warnings: tuple[str, ...]
    seconds: dict[str, float]


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]  # threads slow small products
def capture_performer(video: DepthVideo, *, settings: Settings | None = None) -> Capture:
    """Turn a depth video into a rigged performer: its seen side, a skeleton and a clip.

    Args:
        video: one still camera, one moving subject.
        settings: of the tracking; None for the best known.

    Raises:
        ValueError: if no frame shows a subject, or only one does.
    """
    watch = Stopwatch()
    watch.begin("subject")
    seen = view_subject(video)

    watch.begin("tracking")
    camera, settings = (video.intrinsics, seen.diagonal), settings or Settings()
    followed = track(seen.views, 0, *camera, settings=settings, progress=announce_frames())
    if followed.doubtful and settings.other_starts:
        watch.begin("choosing a frame")
        reference = choose_reference(seen.views, *camera, settings=settings)
        watch.begin("tracking")
        if reference:
            announce = announce_frames()
            followed = track(seen.views, reference, *camera, settings=settings, progress=announce)
    eye = -standing_place(followed.places[followed.reference])
    paths, faces = followed.places + eye, seen.views[followed.reference].faces

    watch.begin("skeleton and skin")
    curves = extract_curves(paths[followed.reference], faces)
    bones, character = rig_surface(curves, paths, faces, followed.reference, seen.times)
    return Capture(
        *(seen.views, seen.times, seen.diagonal, video.intrinsics, followed),
        *(curves, bones, character, eye),
        *(seen.warnings + track_doubts(followed, bones, seen.diagonal), watch.end()),
    )


def rig_surface(
    curves: CurveSkeleton,
    paths: Float[np.ndarray, "frames vertices 3"],
    faces: Int[np.ndarray, "faces 3"],
    reference: int,
    times: Float[np.ndarray, " frames"],
) -> tuple[Bones, Character]:
    """Make a rigged character of a moving surface: bones where it bends, skin, one clip.

    Args:
        curves: of the surface in the reference frame.
        reference: frame that becomes the rest.
    """
    rest = paths[reference]
    bones = make_bones(curves, split_curves(curves, rest, paths), rest)
    bones = merge_bones(bones, rest, paths)
    return bones, rig_bones(bones, (paths, faces), reference, times)


def rig_bones(
    bones: Bones,
    surface: tuple[Float[np.ndarray, "frames vertices 3"], Int[np.ndarray, "faces 3"]],
    reference: int,
    times: Float[np.ndarray, " frames"],
    *,
    rings: Bool[np.ndarray, "bones vertices"] | None = None,
) -> Character:
    """Make a rigged character of a moving surface and its bones: skin, joints, one clip.

    Paper: a joint moves as its ring of vertices does on average (Eq. 14). We: with its bone, so
    that the skin goes where the decomposition found it, not aside by what the two differ.

    Args:
        rings: vertices around each joint, for the paper's way; None for ours.
        surface: its vertices in every frame, and its faces.
        reference: frame that becomes the rest.
    """
    paths, faces = surface
    rest = paths[reference]
    few = np.random.default_rng(0).permutation(len(rest))[:SAMPLES]
    _, rotations, shifts = decompose(rest[few], paths[:, few], bones.owners[few], bones.parents)
    near = neighbourhood(bones.parents)[bones.owners]
    weights = fit_weights(rest, paths, rotations, shifts, near)
    rings = np.zeros((len(bones.joints), len(rest)), bool) if rings is None else rings
    joints = joint_paths(rest, weights, rotations, shifts, rings, bones.joints)
    return build_performer(rest, faces, bones, weights, (rotations, joints), times)


def announce_frames() -> Progress:
    """Say how far the tracking is, and how fast."""
    began = time.perf_counter()

    def announce(done: int, count: int) -> None:
        rate = done / max(time.perf_counter() - began, 1e-9)
        logger.info("tracking %d/%d, %.1f frames/s", done, count, rate)

    return announce

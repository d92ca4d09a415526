"""Move a figure as a subject moves in a depth video ([T4D] Maheshwari et al. 2023, "Transfer4D").

capture = capture_performer(read_depth("recording"))
write_character("performer.glb", Figure(..., capture.character.mesh, ...), capture.character)
transfer = animate_from_depth(capture, figure.mesh)
"""

import logging
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from bunraku.bones.decomposition import decompose, fit_weights, joint_paths, neighbourhood
from bunraku.bones.performer import build_performer, standing_place
from bunraku.bones.splitting import Bones, make_bones, merge_bones, split_curves
from bunraku.curves import CurveSkeleton, extract_curves
from bunraku.depth.meshing import View
from bunraku.depth.subject import view_subject
from bunraku.embedding import Embedding, embed, spread_weights
from bunraku.proxy import Proxy, build_proxy, lift_weights
from bunraku.registration.tracking import Settings, Track, track
from bunraku.retargeting import plan_embedded, retarget_clip, skeleton_of, turned_frames
from bunraku.rotations import invert_rigid
from bunraku.routes.timing import Stopwatch
from bunraku.skinning import keep_influences
from bunraku.types import Character, DepthVideo, MatchError, Mesh, Skin

logger = logging.getLogger(__name__)
MOST_MISFIT = 1.0
SAMPLES = 1500  # vertices that bone motions are fitted to


@dataclass(frozen=True, eq=False)
class Capture:
    """Every stage of what a depth video gave, in metres and the camera's frame."""

    views: tuple[View, ...]  # of the frames in which the subject was seen
    times: Float[np.ndarray, " frames"]
    diagonal: float
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
    followed = track(
        seen.views,
        0,
        video.intrinsics,
        seen.diagonal,
        settings=settings or Settings(),
        progress=report_progress,
    )
    eye = -standing_place(followed.places[followed.reference])
    paths, faces = followed.places + eye, seen.views[followed.reference].faces
    rest = paths[followed.reference]

    watch.begin("skeleton")
    curves = extract_curves(rest, faces)
    bones = make_bones(curves, split_curves(curves, rest, paths), rest)
    bones = merge_bones(bones, rest, paths)

    watch.begin("skin")
    few = np.random.default_rng(0).permutation(len(rest))[:SAMPLES]
    _, rotations, shifts = decompose(rest[few], paths[:, few], bones.owners[few], bones.parents)
    near = neighbourhood(bones.parents)[bones.owners]
    weights = fit_weights(rest, paths, rotations, shifts, near)
    rings = curves.owners == bones.rings[:, None]
    joints = joint_paths(rest, weights, rotations, shifts, rings, bones.joints)
    character = build_performer(rest, faces, bones, weights, (rotations, joints), seen.times)
    return Capture(
        *(seen.views, seen.times, seen.diagonal, followed, curves, bones, character, eye),
        *(seen.warnings, watch.end()),
    )


def report_progress(done: int, count: int) -> None:
    """Say how far the tracking is."""
    logger.info("tracking %d/%d", done, count)


@dataclass(frozen=True, eq=False)
class DepthTransfer:
    """Every stage of moving a figure, in its own place and metres."""

    target_proxy: Proxy
    embedding: Embedding
    character: Character  # the figure as found, bound, with the captured clip
    confidence: float  # 0 to 1
    warnings: tuple[str, ...]
    seconds: dict[str, float]


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def animate_from_depth(
    capture: Capture, figure: Mesh, *, seed: int = 0, force: bool = False
) -> DepthTransfer:
    """Give a figure the skeleton and the motion of a captured performer.

    Args:
        capture: of the depth video.
        figure: what is to move, in any pose and triangulation.
        seed: of the random choices; there are none yet, equal input gives equal output.
        force: give the result even if the figure could not be matched.

    Raises:
        MatchError: if the figure cannot be matched to the performer well enough.
    """
    watch = Stopwatch()
    watch.begin("proxy")
    target = build_proxy(figure.vertices, figure.faces)

    watch.begin("embedding")
    performer, source = capture.character, capture.character.skeleton
    embedding = embed(performer, capture.bones, target.mesh)
    if embedding.misfit > MOST_MISFIT and not force:
        raise MatchError(
            f"the figure does not fit the performer (misfit {embedding.misfit:.2f}, wanted at most "
            f"{MOST_MISFIT}); film a creature of the same kind, or --force"
        )

    watch.begin("skin")
    on_proxy, _ = spread_weights(performer, embedding, target.mesh)
    weights = keep_influences(lift_weights(target, on_proxy, figure.vertices, figure.faces))

    watch.begin("retargeting")
    heading, turns = embedding.heading, embedding.turns
    plan = plan_embedded(source, embedding.joints, turns, heading, embedding.scale)
    bind = turned_frames(source, embedding.joints, heading @ turns)
    clips = tuple(retarget_clip(clip, plan) for clip in performer.clips)
    skin = Skin(weights, invert_rigid(bind))
    return DepthTransfer(
        *(target, embedding, Character(figure, skeleton_of(source, bind), skin, clips)),
        *(1.0, (), watch.end()),
    )

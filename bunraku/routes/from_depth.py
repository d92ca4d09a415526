"""Move a figure as a subject moves in a depth video ([T4D] Maheshwari et al. 2023, "Transfer4D").

capture = capture_performer(read_depth("recording"))
transfer = animate_from_depth(capture, figure.mesh)
"""

from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from bunraku.embedding import MOST_MISFIT, Embedding, embed, spread_weights
from bunraku.proxy import Proxy, build_proxy, lift_weights
from bunraku.retargeting import (
    Retarget,
    plan_embedded,
    retarget_clip,
    skeleton_of,
    start_above,
    turned_frames,
)
from bunraku.rotations import invert_rigid
from bunraku.routes.capturing import Capture, capture_performer
from bunraku.routes.following import Followed, follow_figure
from bunraku.routes.timing import Stopwatch
from bunraku.skinning import keep_influences
from bunraku.types import Character, MatchError, Mesh, Skin

__all__ = ["Capture", "DepthTransfer", "animate_from_depth", "capture_performer"]


@dataclass(frozen=True, eq=False)
class DepthTransfer:
    """Every stage of moving a figure, in its own place and metres."""

    target_proxy: Proxy
    embedding: Embedding
    followed: Followed  # who moves the figure
    plan: Retarget  # what carries the clip over
    character: Character  # the figure as found, bound, with the captured clip
    confidence: float  # 0 to 1
    warnings: tuple[str, ...]
    seconds: dict[str, float]


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def animate_from_depth(
    capture: Capture, figure: Mesh, *, seed: int = 0, force: bool = False, whole: bool = True
) -> DepthTransfer:
    """Give a figure the skeleton and the motion of a captured performer.

    Args:
        capture: of the depth video.
        figure: what is to move, in any pose and triangulation.
        seed: of the random choices; there are none yet, equal input gives equal output.
        force: give the result even if the figure could not be matched.
        whole: whether the figure itself may be followed; else the seen side moves it.

    Raises:
        MatchError: if the figure cannot be matched to the performer well enough.
    """
    watch = Stopwatch()
    watch.begin("proxy")
    target = build_proxy(figure.vertices, figure.faces)

    watch.begin("embedding")
    performer = capture.character
    embedding = embed(performer, capture.bones, target.mesh)
    if embedding.misfit > MOST_MISFIT and not force:
        raise MatchError(
            f"the figure does not fit the performer (misfit {embedding.misfit:.2f}, wanted at most "
            f"{MOST_MISFIT}); film a creature of the same kind, or --force"
        )

    watch.begin("skin")
    on_proxy, _ = spread_weights(performer, embedding, target.mesh)

    watch.begin("following the figure")
    followed = follow_figure(capture, embedding, target.mesh, on_proxy, whole=whole)
    found = lift_weights(target, followed.weights, figure.vertices, figure.faces)
    weights = keep_influences(found)

    watch.begin("retargeting")
    source, heading, turns = followed.performer.skeleton, embedding.heading, followed.turns
    plan = plan_embedded(source, followed.joints, turns, heading, embedding.scale)
    bind = turned_frames(source, followed.joints, heading @ turns)
    carried = (retarget_clip(clip, plan) for clip in followed.performer.clips)
    clips = tuple(start_above(clip, followed.joints[0]) for clip in carried)
    skin = Skin(weights, invert_rigid(bind))
    return DepthTransfer(
        *(
            target,
            embedding,
            followed,
            plan,
            Character(figure, skeleton_of(source, bind), skin, clips),
        ),
        *(embedding.confidence, embedding.doubts + followed.doubts, watch.end()),
    )

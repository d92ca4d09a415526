"""Move an unrigged figure with the rig and clips of a character ([IE] Musoni et al. 2021).

transfer = animate_from_rig(builtin.human(), figure.mesh)
moved = play_clip(transfer.character, transfer.character.clips[0])
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from bunraku.proxy import Proxy, build_proxy
from bunraku.registration.body import posed_turns, wrap_character
from bunraku.registration.consensus import register_with_landmarks
from bunraku.registration.search import Registration
from bunraku.reposing import Reposed, repose
from bunraku.retargeting import (
    Retarget,
    carry_clips,
    dress,
    dress_source,
    heading_frames,
    plan_retarget,
    skeleton_of,
    turned_frames,
)
from bunraku.rotations import invert_rigid
from bunraku.routes.timing import Stopwatch
from bunraku.skeletons import carry_joints, turn_trust
from bunraku.types import Character, Clip, MatchError, Mesh, Skeleton, Skin
from bunraku.weights import skin_from_registration

MOST_STRAIN = 0.54  # balls, boxes, tori: .57 to .9; chibis under a realistic body: up to .5


@dataclass(frozen=True, eq=False)
class RigTransfer:
    """Every stage of the route, in the figure's own place and metres."""

    source_proxy: Proxy
    target_proxy: Proxy
    registration: Registration
    reposed: Reposed
    plan: Retarget  # what carries clips over
    character: Character  # the figure as found, bound, with the clips carried over
    rested: Skeleton  # the same skeleton in the source's rest pose
    repose_motion: Float[np.ndarray, "joints 4 4"]  # world_from_world: as found -> at rest
    confidence: float  # 0 to 1
    mirrored: bool  # never: turning and stretching bones cannot swap left and right
    score: float  # strain of the registration: 0 perfect, above .54 refused
    warnings: tuple[str, ...]
    seconds: dict[str, float]


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]  # threads slow small products
def animate_from_rig(
    source: Character,
    figure: Mesh,
    *,
    clips: Sequence[Clip] | None = None,
    landmarks: Mapping[str, Sequence[float]] | None = None,
    seed: int = 0,
    force: bool = False,
) -> RigTransfer:
    """Give a figure the source's skeleton, skin and clips.

    Args:
        source: character with a surface; its clips beyond `clips` only suggest poses.
        figure: what is to move, in any pose and triangulation.
        clips: the ones to carry over; None for all of the source's.
        landmarks: places of any few of the source's joints on the figure, never needed.
        seed: of the random choices; there are none yet, equal input gives equal output.
        force: give the result even if the figure could not be matched.

    Raises:
        MatchError: if the figure cannot be matched to the source well enough.
    """
    watch = Stopwatch()
    watch.begin("proxy")
    body = wrap_character(source)
    target = build_proxy(figure.vertices, figure.faces)

    watch.begin("registration")
    names = source.skeleton.names
    registration, misplaced = register_with_landmarks(body, target.mesh, landmarks, names)
    if registration.strain > MOST_STRAIN and not force:
        raise MatchError(
            f"the figure does not fit the performance (strain {registration.strain:.2f}, wanted at "
            f"most {MOST_STRAIN}); choose a performance of the same kind of creature, or --force"
        )

    watch.begin("skin and skeleton")
    weights = skin_from_registration(body, registration, target, figure)
    joints = registration.joints  # surer where nothing turned; else the surface knows as much
    if not registration.at_rest:
        by_surface = carry_joints(*body.surface, body.joints, body.parents, registration.fitted)
        joints = (joints + by_surface) / 2

    watch.begin("rest pose")
    turns, trust = posed_turns(body, registration.pose), turn_trust(body.areas, body.weights)
    misfit = registration.error
    reposed = repose(joints, body, turns, trust, misfit=misfit, at_rest=registration.at_rest)
    plan, reposed = plan_retarget(body, reposed, figure, weights, source.skeleton)
    bind = turned_frames(source.skeleton, reposed.found, reposed.heading @ reposed.turns)

    watch.begin("retargeting")
    worn = dress_source(body, source.skeleton), dress(target.mesh, figure, weights, bind)
    plan, carried = carry_clips(source.clips if clips is None else clips, plan, *worn)
    skin, rest = Skin(weights, invert_rigid(bind)), heading_frames(plan)
    return RigTransfer(
        *(body.proxy, target, registration, reposed, plan),
        Character(figure, skeleton_of(source.skeleton, bind), skin, carried),
        skeleton_of(source.skeleton, rest),
        rest @ skin.inverse_bind,
        *(registration.confidence, False, registration.strain),
        *(misplaced + registration.doubts, watch.end()),
    )

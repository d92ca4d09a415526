"""Move a figure as an avatar was posed ([ZPT] Wang et al. 2023, "Zero-shot pose transfer").

transfer = animate_from_avatar(read, avatar, poses, figure.mesh)
"""

from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from bunraku.neural.avatars import Poses, rest_difference, rig_avatar, unlikeness
from bunraku.neural.parts import Reader, Understanding, standing_height
from bunraku.neural.smoothing import stiffen
from bunraku.retargeting import Retarget, plan_embedded, retarget_clip, skeleton_of, turned_frames
from bunraku.rotations import invert_rigid
from bunraku.routes.from_rig import RigTransfer, animate_from_rig
from bunraku.routes.timing import Stopwatch
from bunraku.skinning import keep_influences
from bunraku.types import Character, MatchError, Mesh, Skin

NETWORK, REGISTRATION = "network", "registration"
FITS = 0.31  # strain up to which the registration is believed, chosen in-sample
UNLIKE = 0.3  # difference of proportions from which no surface is fitted: it would be in vain
LEAST_CONFIDENCE, DOUBTED = 0.25, 0.5  # bad pairs reach .15, good ones .40 at least (in-sample)


@dataclass(frozen=True, eq=False)
class AvatarTransfer:
    """Every stage of the route, in the figure's own place and metres."""

    avatar: Understanding
    performer: Character  # the avatar, rigged; its poses are the clip
    figure: Understanding
    learned: Character  # the figure by the network alone
    plan: Retarget  # what carried the clip over, of the network's answer
    registered: RigTransfer | None  # second opinion: the avatar's surface fitted
    chosen: str  # "network" or "registration"
    character: Character  # by the chosen one
    confidence: float  # 0 to 1
    warnings: tuple[str, ...]
    seconds: dict[str, float]


@threadpool_limits.wrap(limits=1)  # type: ignore[untyped-decorator]
def animate_from_avatar(
    read: Reader,
    avatar: Mesh,
    poses: Poses,
    figure: Mesh,
    *,
    rate: float = 24.0,
    force: bool = False,
) -> AvatarTransfer:
    """Give a figure a skeleton, a skin and the poses of an avatar that has neither.

    The network's answer gets a second opinion. A surface that fits tells joints and weights better
    than any network; where proportions differ it tells nothing, and the network still knows parts.

    Args:
        read: who understands figures: `understanding.load_reader`.
        avatar: at rest.
        poses: its vertices in each pose.
        figure: what is to move, at rest.
        rate: poses a second, in the clip.
        force: give the result even if avatar or figure could not be understood.

    Raises:
        MatchError: if avatar or figure cannot be understood well enough.
    """
    watch = Stopwatch()
    watch.begin("avatar")
    seen = read(avatar)
    performer = rig_avatar(avatar, poses, seen, times=np.arange(len(poses)) / rate)

    watch.begin("figure")
    understood = read(figure, kind=seen.kind)
    learned, plan = carry_learned(performer, seen, understood, figure)

    watch.begin("second opinion")
    registered, chosen, character = None, NETWORK, learned
    known, sure, doubts = sureness(seen), sureness(understood), list[str]()
    if known * sure >= LEAST_CONFIDENCE and unlikeness(seen, understood) < UNLIKE:
        registered = animate_from_rig(performer, figure, force=True)
        if registered.score <= FITS:
            chosen, character = REGISTRATION, registered.character
            sure, doubts = registered.confidence, list(registered.warnings)
    if (confidence := known * sure) < DOUBTED:
        doubts.append(
            f"hardly understood as a {seen.kind} ({sure:.2g}, the avatar {known:.2g} of 1)"
        )
    if confidence < LEAST_CONFIDENCE and not force:
        raise MatchError(f"{doubts[-1]}; give two of a kind, upright (--up, --facing), or --force")
    return AvatarTransfer(
        *(seen, performer, understood, learned, plan, registered, chosen, character),
        *(confidence, tuple(doubts), watch.end()),
    )


def sureness(seen: Understanding) -> float:
    """Tell how surely a body is understood, 0 to 1; boxes and balls have 1 to 4 parts of 20."""
    return seen.chance * seen.agreement * len(np.unique(seen.labels)) / seen.weights.shape[1]


def carry_learned(
    performer: Character, seen: Understanding, understood: Understanding, figure: Mesh
) -> tuple[Character, Retarget]:
    """Rig a figure as the network understands it, and carry the avatar's poses over."""
    turns, joints = rest_difference(seen, understood), understood.joints
    scale = standing_height(figure, joints) / standing_height(performer.mesh, seen.joints)
    plan = plan_embedded(performer.skeleton, joints, turns, np.eye(3), scale)
    bind = turned_frames(performer.skeleton, joints, turns)
    clips = tuple(retarget_clip(clip, plan) for clip in performer.clips)
    weights = keep_influences(stiffen(understood.weights, figure))
    skin, skeleton = Skin(weights, invert_rigid(bind)), skeleton_of(performer.skeleton, bind)
    return Character(figure, skeleton, skin, clips), plan

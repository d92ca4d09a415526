"""Move a figure as an avatar was posed ([ZPT] Wang et al. 2023, "Zero-shot pose transfer").

transfer = animate_from_avatar(read, avatar, poses, figure.mesh)
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from bunraku.neural.avatars import Poses, rest_difference, rig_avatar, unlikeness
from bunraku.neural.parts import Reader, Understanding
from bunraku.retargeting import Retarget, plan_embedded, retarget_clip, skeleton_of, turned_frames
from bunraku.rotations import invert_rigid
from bunraku.routes.from_rig import RigTransfer, animate_from_rig
from bunraku.routes.timing import Stopwatch
from bunraku.skinning import keep_influences
from bunraku.types import Character, MatchError, Mesh, Skin

NETWORK, REGISTRATION = "network", "registration"
FITS = 0.31  # strain up to which the registration is believed, chosen in-sample
UNLIKE = 0.3  # difference of proportions from which no surface is fitted: it would be in vain
LEAST_AGREEMENT = 0.6  # of the network with itself, below which a figure is not understood
LEAST_CONFIDENCE = 0.25  # horses as people 7e-5, boxes .12, ten vertices .13; good pairs from .40
DOUBTED = 0.5  # confidence below which a result comes with a warning


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
    if not force:
        refuse_unsure(sureness(seen), "avatar", seen.kind)
    performer = rig_avatar(avatar, poses, seen, times=np.arange(len(poses)) / rate)

    watch.begin("figure")
    understood = read(figure, kind=seen.kind)
    if understood.agreement < LEAST_AGREEMENT and not force:
        raise MatchError(
            f"the figure is not understood as a {seen.kind} (agreement "
            f"{understood.agreement:.2f}, wanted at least {LEAST_AGREEMENT}); is it at rest, "
            "upright and facing +Z? See --up and --facing, or --force"
        )
    learned, plan = carry_learned(performer, seen, understood, figure)

    watch.begin("second opinion")
    registered, chosen, character = None, NETWORK, learned
    confidence = sureness(seen) * sureness(understood)
    doubts: tuple[str, ...] = ()
    if unlikeness(seen, understood) < UNLIKE:
        registered = animate_from_rig(performer, figure, force=True)
        if registered.score <= FITS:
            chosen, character = REGISTRATION, registered.character
            confidence = sureness(seen) * registered.confidence
            doubts = registered.warnings
    if not force:
        refuse_unsure(confidence, "figure", seen.kind)
    if confidence < DOUBTED:
        doubts = (*doubts, f"is hardly understood as a {seen.kind} (confidence {confidence:.2g})")
    return AvatarTransfer(
        *(seen, performer, understood, learned, plan, registered, chosen, character),
        *(confidence, doubts, watch.end()),
    )


def sureness(seen: Understanding) -> float:
    """Tell how surely a body is understood, 0 to 1: its kind, its parts, and how many are there.

    Triangles, boxes and balls have one to four parts of 20, the people and quadrupeds of the
    evaluation data 14 at least.
    """
    there = len(np.unique(seen.labels)) / seen.weights.shape[1]
    return seen.chance * seen.agreement * there


def refuse_unsure(confidence: float, what: str, kind: str) -> None:
    """Refuse what is not understood well enough.

    Raises:
        MatchError: if the confidence is under the bar.
    """
    if confidence < LEAST_CONFIDENCE:
        raise MatchError(
            f"the {what} is not understood as a {kind} (confidence {confidence:.2g}, wanted at "
            f"least {LEAST_CONFIDENCE}); give a body of the same kind, at rest, upright and facing "
            "+Z, or --force"
        )


def carry_learned(
    performer: Character, seen: Understanding, understood: Understanding, figure: Mesh
) -> tuple[Character, Retarget]:
    """Rig a figure as the network understands it, and carry the avatar's poses over."""
    turns, joints = rest_difference(seen, understood), understood.joints
    scale = standing_height(figure, joints) / standing_height(performer.mesh, seen.joints)
    plan = plan_embedded(performer.skeleton, joints, turns, np.eye(3), scale)
    bind = turned_frames(performer.skeleton, joints, turns)
    clips = tuple(retarget_clip(clip, plan) for clip in performer.clips)
    skin = Skin(keep_influences(understood.weights), invert_rigid(bind))
    return Character(figure, skeleton_of(performer.skeleton, bind), skin, clips), plan


def standing_height(mesh: Mesh, joints: Float[np.ndarray, "parts 3"]) -> float:
    """Give the height of the hips over the ground."""
    return max(float(joints[0, 1] - mesh.vertices[:, 1].min()), 1e-6)

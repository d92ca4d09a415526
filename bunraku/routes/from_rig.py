"""Move an unrigged figure with the rig and clips of a character ([IE] Musoni et al. 2021).

transfer = animate_from_rig(builtin.human(), figure.mesh)
moved = play_clip(transfer.character, transfer.character.clips[0])
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bunraku.meshes import closest_points, interpolate
from bunraku.proxy import Proxy, build_proxy, lift_weights
from bunraku.registration.body import Body, wrap_character
from bunraku.registration.search import Registration, register_body
from bunraku.reposing import Reposed, repose
from bunraku.retargeting import Retarget, face_heading, rest_frames, retarget_clip
from bunraku.rotations import compose_transforms, invert_rigid
from bunraku.routes.timing import Stopwatch
from bunraku.skeletons import carry_joints, surface_turns
from bunraku.skinning import keep_influences, linear_blend_skinning, local_transforms
from bunraku.types import Character, Clip, MatchError, Mesh, Skeleton, Skin

LEAST_CONFIDENCE = 0.1


@dataclass(frozen=True, eq=False)
class RigTransfer:
    """Every stage of the route, in the figure's own place and metres."""

    source_proxy: Proxy
    target_proxy: Proxy
    registration: Registration
    joints: Float[np.ndarray, "joints 3"]  # in the figure's pose as found
    reposed: Reposed
    character: Character  # the figure as found, bound, with the clips carried over
    rested: Skeleton  # the same skeleton in the source's rest pose
    repose_motion: Float[np.ndarray, "joints 4 4"]  # world_from_world: as found -> at rest
    confidence: float  # 0 to 1
    mirrored: bool
    score: float  # misfit of the registration: 0 perfect, 2 nowhere near
    warnings: tuple[str, ...]
    seconds: dict[str, float]


def animate_from_rig(
    source: Character,
    figure: Mesh,
    *,
    clips: Sequence[Clip] | None = None,
    seed: int = 0,
    force: bool = False,
) -> RigTransfer:
    """Give a figure the source's skeleton, skin and clips.

    Args:
        source: character with a surface; its clips beyond `clips` only suggest poses.
        figure: what is to move, in any pose and triangulation.
        clips: the ones to carry over; None for all of the source's.
        force: give the result even if the figure could not be matched.

    Raises:
        MatchError: if the figure cannot be matched to the source well enough.
    """
    watch = Stopwatch()
    watch.begin("proxy")
    body = wrap_character(source)
    target = build_proxy(figure.vertices, figure.faces)

    watch.begin("registration")
    registration = register_body(body, target.mesh)
    confidence = trust_in(registration)
    if confidence < LEAST_CONFIDENCE and not force:
        raise MatchError(
            f"the figure does not fit the performance (misfit {registration.error:.2f}, wanted "
            "below .35); choose a performance of the same kind of creature, or --force"
        )

    watch.begin("skin and skeleton")
    skin_weights = transfer_skin(body, registration, target, figure)
    joints = carry_joints(*body.surface, body.joints, body.parents, registration.fitted)

    watch.begin("rest pose")
    turns, trust = surface_turns(*body.surface, body.carriers, registration.fitted)
    reposed = repose(joints, body.joints, body.carriers, turns, trust)
    bind = bind_frames(source, joints, reposed)
    retarget, rest = stand(source, figure, body, reposed, skin_weights, bind)

    watch.begin("retargeting")
    parents, names = source.skeleton.parents, source.skeleton.names
    skeleton = Skeleton(names, parents, local_transforms(parents, bind))
    carried = tuple(retarget_clip(c, retarget) for c in (source.clips if clips is None else clips))
    character = Character(figure, skeleton, Skin(skin_weights, invert_rigid(bind)), carried)
    return RigTransfer(
        *(body.proxy, target, registration, joints, reposed, character),
        Skeleton(names, parents, local_transforms(parents, rest)),
        rest @ invert_rigid(bind),
        *(confidence, False, registration.error, (), watch.end()),
    )


def trust_in(registration: Registration) -> float:
    """Turn the misfit into a confidence: .94 at .1, one half at .2, .1 at .35."""
    return float(1.0 / (1.0 + (registration.error / 0.2) ** 4))


def transfer_skin(
    body: Body, registration: Registration, target: Proxy, figure: Mesh
) -> Float[np.ndarray, "vertices joints"]:
    """Read the skin off the registered source, lift it to the figure, keep four influences."""
    face, shares, _ = closest_points(
        target.mesh.vertices, registration.fitted, body.proxy.mesh.faces
    )
    on_proxy = interpolate(body.weights, body.proxy.mesh.faces[face], shares)
    return keep_influences(lift_weights(target, on_proxy, figure.vertices, figure.faces))


def bind_frames(
    source: Character, joints: Float[np.ndarray, "joints 3"], reposed: Reposed
) -> Float[np.ndarray, "joints 4 4"]:
    """Give world_from_joint of the figure as found: the source's rest frames, turned with it."""
    at_rest = rest_frames(source.skeleton, joints)[:, :3, :3]
    return compose_transforms(joints, reposed.heading @ reposed.turns @ at_rest)


def stand(
    source: Character,
    figure: Mesh,
    body: Body,
    reposed: Reposed,
    weights: Float[np.ndarray, "vertices joints"],
    bind: Float[np.ndarray, "joints 4 4"],
) -> tuple[Retarget, Float[np.ndarray, "joints 4 4"]]:
    """Stand the reposed figure on the ground it was found on; scale travel by the hips' height."""
    plan = Retarget(source.skeleton, reposed.places, body.carriers, 1.0, reposed.heading)
    rest = face_heading(plan) @ rest_frames(source.skeleton, reposed.places)
    rested = linear_blend_skinning(figure.vertices, weights, rest @ invert_rigid(bind))
    lift = np.array([0.0, figure.vertices[:, 1].min() - rested[:, 1].min(), 0.0])
    hips = body.puppet.joints[0]
    height = rest[hips, 1, 3] - rested[:, 1].min()
    own_height = body.joints[hips, 1] - source.mesh.vertices[:, 1].min()
    scale = float(height / own_height) if own_height > 1e-6 and height > 1e-6 else 1.0
    plan = Retarget(source.skeleton, reposed.places + lift, body.carriers, scale, reposed.heading)
    return plan, face_heading(plan) @ rest_frames(source.skeleton, plan.places)

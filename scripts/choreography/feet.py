"""Feet that stay where they are put: roll over heel, ball and toe tip, and steps between."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from bunraku.builtin import human
from choreography.body import JOINTS, Foot, Triples, about
from choreography.curves import Keys, columns, keyed, looped

SOLE = human().mesh.vertices[human().mesh.vertices[:, 1] < 0.015]
ANKLE = np.array([0.0, JOINTS["leftFoot"][1], 0.0])
BALL = np.array([0.0, *(JOINTS["leftToes"] - JOINTS["leftFoot"])[1:]]) + ANKLE
HEEL = np.array([0.0, 0.0, SOLE[:, 2].min() + 0.018 - JOINTS["leftFoot"][2]])
TIP = np.array([0.0, 0.0, SOLE[:, 2].max() - 0.006 - JOINTS["leftFoot"][2]])


def rolled(
    place: Triples, yaw: Float[np.ndarray, " frames"], pitch: Float[np.ndarray, " frames"]
) -> tuple[Triples, Float[np.ndarray, " frames"]]:
    """Roll feet that stand: over the heel if the toes are up, else over ball and toe tip.

    Args:
        place: the point of the floor under the ankle when the foot stands flat.
        yaw: where it points, in degrees.
        pitch: of the foot, in degrees; the toes stay flat up to 38, then they roll over their tip.

    Returns:
        the ankle's place, and the pitch of the toes.
    """
    heading = about("y", yaw)
    toes = np.where(pitch < 0, pitch, np.clip(pitch - 38.0, 0.0, None))
    ball = TIP + np.einsum("fij,j->fi", about("x", np.maximum(toes, 0.0)), BALL - TIP)
    over_ball = ball + np.einsum("fij,j->fi", about("x", pitch), ANKLE - BALL)
    over_heel = HEEL + np.einsum("fij,j->fi", about("x", pitch), ANKLE - HEEL)
    local = np.where((pitch < 0)[:, None], over_heel, over_ball)
    return place + np.einsum("fij,fj->fi", heading, local), toes


def planted(
    place: Triples,
    yaw: Float[np.ndarray, " frames"] | float,
    *,
    pitch: Float[np.ndarray, " frames"] | float = 0.0,
    knee: Float[np.ndarray, " frames"] | float = 0.0,
) -> Foot:
    """Stand at a place, heel lifted by `pitch` > 0 or toes by `pitch` < 0."""
    zero = np.zeros(len(place))
    ankle, toes = rolled(place, yaw + zero, pitch + zero)
    return Foot(ankle, columns(yaw, pitch + zero, 0.0), toes, knee)


@dataclass(frozen=True)
class Step:
    """A step to a place of the floor: from when to when (seconds), where, how high."""

    start: float
    end: float
    x: float
    z: float
    yaw: float
    height: float = 0.07


def stepping(
    times: Float[np.ndarray, " frames"],
    first: tuple[float, float, float],
    steps: tuple[Step, ...],
    *,
    knee: Float[np.ndarray, " frames"] | float = 0.0,
) -> Foot:
    """Stand at (x, z, yaw), and make steps: heel up, off, over, ball down, heel down."""
    where = np.tile(np.array([first[0], 0.0, first[1], first[2]]), (len(times), 1))
    pitch = np.zeros(len(times))
    for step in steps:
        duration = step.end - step.start
        share = np.clip((times - step.start) / duration, 0.0, 1.0)
        late = np.clip((share - 0.1) / 0.8, 0.0, 1.0)
        ease = late**3 * (late * (6 * late - 15) + 10)
        where += np.multiply.outer(ease, [step.x, 0.0, step.z, step.yaw] - where[-1] * [1, 0, 1, 1])
        where[:, 1] += step.height * np.sin(np.pi * share) ** 2
        roll = [(-0.35, 0.0), (0.0, 24.0), (0.35, 26.0), (0.8, 2.0), (0.9, 5.0), (1.15, 0.0)]
        pitch += keyed((times - step.start) / duration, roll)
    return planted(where[:, :3], where[:, 3], pitch=pitch, knee=knee)


@dataclass(frozen=True)
class Stride:
    """What one foot does in a cycle of walking or running; phase 0 is when it lands.

    length: metres the body travels in a cycle; lift_off: phase; lead: how far ahead of the hips it
    lands; width: from the middle; pitch: keys (phase, degrees) of the whole cycle; flight: keys
    (phase, metres ahead of the hips, ankle height) between lift-off and landing.
    """

    length: float
    lift_off: float
    lead: float
    width: float
    toe_out: float
    pitch: Keys
    flight: tuple[tuple[float, float, float], ...]


def stride_foot(stride: Stride, phase: Float[np.ndarray, " frames"], side: str) -> Foot:
    """Move a foot through cycles of a stride; velocity is continuous at lift-off and landing.

    Args:
        stride: what the foot does in a cycle.
        phase: of the body, whole where the left foot lands; the right foot is half a cycle late.
        side: which foot.
    """
    sign = 1.0 if side == "left" else -1.0
    within = np.mod(phase - (0.0 if side == "left" else 0.5), 1.0)
    pitch = looped(within, stride.pitch)
    yaw = np.full(len(phase), sign * stride.toe_out)
    ankle, toes = stance(stride, within, side)
    flying = within >= stride.lift_off
    ankle[flying] = flight(stride, side)(within[flying])
    bend = toes_at(stride, side) - looped(np.array([stride.lift_off]), stride.pitch)[0]
    keys = [(stride.lift_off, bend), (stride.lift_off + 0.12, -8.0), (0.92, -6.0), (1.0, 0.0)]
    toes[flying] = (pitch + keyed(within, keys))[flying]
    ankle[:, 2] += phase * stride.length
    return Foot(ankle, columns(yaw, pitch, 0.0), toes)


def stance(
    stride: Stride, within: Float[np.ndarray, " frames"], side: str
) -> tuple[Triples, Float[np.ndarray, " frames"]]:
    """Give the ankle's place relative to the hips, and the toes' pitch, as if the foot stood."""
    sign = 1.0 if side == "left" else -1.0
    place = columns(sign * stride.width, 0.0, stride.lead - within * stride.length)
    yaw = np.full(len(within), sign * stride.toe_out)
    return rolled(place, yaw, looped(within, stride.pitch))


def toes_at(stride: Stride, side: str) -> float:
    """Give the pitch of the toes at lift-off."""
    return float(stance(stride, np.array([stride.lift_off]), side)[1][0])


def flight(stride: Stride, side: str) -> CubicSpline:
    """Draw the ankle's way, relative to the hips, from lift-off to the next landing."""
    moment = 1e-3
    ends = np.array([stride.lift_off - moment, stride.lift_off, 0.0, moment])
    points, _ = stance(stride, ends, side)
    x = points[1, 0]
    inner = [(x, height, ahead) for _, ahead, height in stride.flight]
    phases = [stride.lift_off, *(key[0] for key in stride.flight), 1.0]
    leaving, landing = (points[1] - points[0]) / moment, (points[3] - points[2]) / moment
    path = np.array([points[1], *inner, points[2]])
    return CubicSpline(phases, path, bc_type=((1, leaving), (1, landing)))

"""Clips about the spot: idle, wave, turn, cheer."""

import numpy as np
from jaxtyping import Float

from choreography.body import STANDING, Arm, Foot, Posture, settle
from choreography.curves import columns, frame_times, keyed, looped, wave
from choreography.feet import Step, planted, stepping

HALF_WIDTH = 0.10
TOE_OUT = 9.0
EASY = 0.9965  # of the leg's length: knees not locked
BALANCE = 0.016  # metres that the hips are ahead of the ankles
Curve = Float[np.ndarray, " frames"]


def stance(times: Curve, side: str, *, heel: Curve | float = 0.0) -> Foot:
    """Stand at ease with one foot."""
    sign = 1.0 if side == "left" else -1.0
    zero = np.zeros(len(times))
    return planted(columns(zero + sign * HALF_WIDTH, 0.0, 0.0), sign * TOE_OUT, pitch=heel)


def breath(times: Curve, seconds: float = 3.0) -> Curve:
    """Breathe in and out between 0 and 1; in faster than out."""
    return looped(times / seconds, [(0.0, 0.0), (0.4, 1.0), (0.5, 0.98)])


def idle() -> Posture:
    """Stand, breathe, shift the weight from one leg to the other and back, look around."""
    times = frame_times(6.0)
    phase, breathing = times / 6.0, breath(times)
    shift = looped(phase, [(0.0, -1.0), (0.36, -0.9), (0.52, 1.0), (0.84, 0.9)])  # -1: right leg
    late = looped(phase - 0.025, [(0.0, -1.0), (0.36, -0.9), (0.52, 1.0), (0.84, 0.9)])
    look = looped(
        phase,
        [
            (0.05, 0.0),
            (0.16, 13.0),
            (0.3, 12.0),
            (0.44, -3.0),
            (0.62, -11.0),
            (0.76, -9.0),
            (0.9, 0.0),
        ],
    )
    nod = looped(phase, [(0.0, 2.0), (0.2, -1.0), (0.45, 3.5), (0.7, 0.0)])

    def arm(side: float, swing: float) -> Arm:
        return Arm(
            swing=swing - 1.5 * breathing + 1.5 * side * late,
            spread=10.0 + 1.2 * breathing - 2.0 * side * late,
            elbow=16.0 + 2.0 * breathing + 2.5 * side * late,
            shrug=1.8 * breathing,
            reach=2.0 * wave(phase, 0.3),
        )

    return settle(
        Posture(
            hips=columns(
                0.030 * shift,
                STANDING - 0.006 * shift**2 + 0.003 * breathing,
                BALANCE + 0.006 * wave(phase, 0.7),
            ),
            pelvis=columns(-3.0 * shift, 1.0 + 0.5 * breathing, 2.6 * shift),
            chest=columns(0.18 * look - 1.0 * late, 1.0 - 1.8 * breathing, -1.6 * late),
            head=columns(look, nod - 0.5 * breathing, -1.2 * late + 0.06 * look),
            left_foot=stance(times, "left"),
            right_foot=stance(times, "right"),
            left_arm=arm(1.0, 5.0),
            right_arm=arm(-1.0, 3.0),
        ),
        EASY,
        loop=True,
    )


def wave_hand() -> Posture:
    """Greet: the right hand goes up, waves three times and comes down."""
    times = frame_times(3.0)
    breathing = breath(times)
    up = keyed(
        times, [(0.12, 0.0), (0.62, 1.04), (0.78, 1.0), (2.10, 1.0), (2.72, -0.03), (2.95, 0.0)]
    )
    body = keyed(times, [(0.0, 0.0), (0.18, -0.12), (0.7, 1.0), (2.0, 0.9), (2.7, 0.0)])
    beat = keyed(times, [(0.60, 0.0), (0.85, 1.0), (2.05, 1.0), (2.3, 0.0)])
    swaying = beat * np.sin(2 * np.pi * (times - 0.62) / 0.48)
    late = beat * np.sin(2 * np.pi * (times - 0.69) / 0.48)
    outward = keyed(times, [(0.10, 0.0), (0.52, 1.0), (2.14, 1.0), (2.66, 0.0)])
    bent = keyed(times, [(0.06, 0.0), (0.5, 1.08), (0.72, 1.0), (2.16, 1.0), (2.8, 0.0)])
    waving = Arm(
        swing=4.0 + 46.0 * up,
        spread=10.0 + 44.0 * up + 4.0 * swaying,
        twist=4.0 - 28.0 * outward - 13.0 * swaying,
        elbow=16.0 + 2.0 * breathing + 98.0 * bent - 6.0 * swaying,
        pronate=10.0 + 40.0 * up,
        wrist=6.0 - 12.0 * up,
        tilt=6.0 - 16.0 * late,
        shrug=4.0 * up,
    )
    return settle(
        Posture(
            hips=columns(0.022 * body, STANDING - 0.006 * np.abs(body), BALANCE),
            pelvis=columns(-3.0 * body, 1.0, 2.0 * body),
            chest=columns(
                -6.0 * body + 1.5 * swaying, 1.0 - 2.0 * body - breathing, -3.5 * body + 1.2 * late
            ),
            head=columns(-4.0 * body, 2.0 - 3.0 * body, 5.0 * body + 1.5 * late),
            left_foot=stance(times, "left"),
            right_foot=stance(times, "right"),
            left_arm=Arm(
                swing=4.0 - 3.0 * body - 1.0 * late,
                spread=10.0 + 3.0 * body,
                elbow=16.0 + 5.0 * body,
            ),
            right_arm=waving,
        ),
        EASY,
    )


LEFT_STEPS = (Step(0.30, 0.66, 0.05, -0.087, 75.0), Step(1.14, 1.48, -0.10, 0.0, 189.0))
RIGHT_STEPS = (Step(0.72, 1.08, 0.057, 0.082, 130.0), Step(1.54, 1.86, 0.10, 0.0, 171.0))
PLACES = (  # seconds, x, z: the hips go over the foot that stands
    *((0.05, 0.0, 0.0), (0.14, 0.012, 0.0), (0.44, -0.05, 0.0), (0.56, -0.05, 0.0)),
    *((0.90, 0.03, -0.052), (1.30, 0.034, 0.048), (1.68, -0.05, 0.004), (2.15, 0.0, 0.0)),
)
DIPS = (  # seconds, metres: down before each step, up over it
    *((0.0, 0.0), (0.22, -0.02), (0.48, -0.003), (0.69, -0.02), (0.90, -0.003), (1.11, -0.02)),
    *((1.31, -0.003), (1.51, -0.02), (1.70, -0.004), (1.92, -0.014), (2.35, 0.0)),
)


def turn() -> Posture:
    """Turn round to the left: eyes, head, chest, pelvis, then four steps."""
    times = frame_times(2.6)

    def led(early: float, overshoot: float) -> Curve:
        keys = [(0.24, 0.0), (0.66, 40.0), (1.08, 102.0), (1.48, 154.0), (1.82, 180.0 + overshoot)]
        return keyed(times + early, [*keys, (2.2, 180.0)])

    place = keyed(times, [(at, where) for at, *where in PLACES])
    pelvis, chest, head = led(0.0, 1.0), led(0.12, 3.0), led(0.24, 4.0)
    spin = np.gradient(chest, times) / 180.0
    facing = np.radians(pelvis)

    def arm(side: float) -> Arm:
        return Arm(
            swing=4.0 - 12.0 * side * spin,
            spread=10.0 + 9.0 * np.roll(spin, 3),
            elbow=16.0 + 10.0 * spin,
        )

    return settle(
        Posture(
            hips=columns(
                place[:, 0] + BALANCE * np.sin(facing),
                STANDING + keyed(times, DIPS),
                place[:, 1] + BALANCE * np.cos(facing),
            ),
            pelvis=columns(pelvis, 1.5, 2.5 * spin),
            chest=columns(chest, 2.0 + 2.0 * spin, 1.5 * spin),
            head=columns(head, 2.0 + 6.0 * spin, -2.0 * spin),
            left_foot=stepping(times, (HALF_WIDTH, 0.0, TOE_OUT), LEFT_STEPS),
            right_foot=stepping(times, (-HALF_WIDTH, 0.0, -TOE_OUT), RIGHT_STEPS),
            left_arm=arm(1.0),
            right_arm=arm(-1.0),
        ),
        EASY,
    )


def cheer() -> Posture:
    """Throw both arms up, bounce on the toes twice, let them fall."""
    times = frame_times(2.6)
    up = keyed(
        times,
        [
            (0.1, 0.0),
            (0.26, -0.12),
            (0.66, 1.05),
            (0.82, 1.0),
            (1.75, 1.0),
            (2.3, -0.03),
            (2.55, 0.0),
        ],
    )
    crouch = keyed(
        times, [(0.0, 0.0), (0.26, 1.0), (0.52, 0.0), (2.0, 0.0), (2.22, 0.25), (2.5, 0.0)]
    )
    heel = keyed(
        times,
        [
            (0.38, 0.0),
            (0.64, 26.0),
            (0.80, 4.0),
            (1.02, 24.0),
            (1.24, 4.0),
            (1.46, 22.0),
            (1.72, 0.0),
        ],
    )
    pump = keyed(
        times,
        [(0.58, 0.0), (0.80, 1.0), (1.02, 0.0), (1.24, 1.0), (1.46, 0.0), (1.70, 0.5), (1.9, 0.0)],
    )
    height = STANDING - 0.10 * crouch + 0.10 * np.sin(np.radians(heel))

    def arm(side: float) -> Arm:
        return Arm(
            swing=4.0 - 26.0 * crouch * (up < 0.2) + 8.0 * up,
            spread=10.0 + 138.0 * np.maximum(up, 0.0) - 6.0 * pump + 2.0 * side,
            twist=4.0 - 34.0 * up,
            elbow=18.0 + 24.0 * crouch + 4.0 * up + 52.0 * pump,
            pronate=10.0,
            wrist=6.0 - 8.0 * up,
            shrug=8.0 * up,
        )

    return settle(
        Posture(
            hips=columns(0.0, height, BALANCE + 0.02 * up - 0.02 * crouch),
            pelvis=columns(0.0, 1.0 + 14.0 * crouch - 3.0 * up, 0.0),
            chest=columns(0.0, 1.0 + 18.0 * crouch - 8.0 * up + 3.0 * pump, 0.0),
            head=columns(0.0, 2.0 + 4.0 * crouch - 14.0 * up + 4.0 * pump, 0.0),
            left_foot=stance(times, "left", heel=heel),
            right_foot=stance(times, "right", heel=heel),
            left_arm=arm(1.0),
            right_arm=arm(-1.0),
        ),
        EASY,
    )

"""Walking and running: two cycles forward, so that the loop closes up to the way travelled."""

import numpy as np
from jaxtyping import Float

from choreography.body import STANDING, Arm, Posture, settle
from choreography.curves import columns, frame_times, wave
from choreography.feet import Stride, stride_foot

CYCLES = 2
WALK = Stride(
    length=1.26,
    lift_off=0.62,
    lead=0.325,
    width=0.062,
    toe_out=6.0,
    pitch=(
        (0.0, -21.0),
        (0.035, -13.0),
        (0.085, 0.0),
        (0.32, 0.0),
        (0.42, 8.0),
        (0.52, 28.0),
        (0.62, 58.0),
        (0.68, 62.0),
        (0.80, 22.0),
        (0.91, -14.0),
        (0.97, -21.0),
    ),
    flight=((0.71, -0.25, 0.225), (0.82, 0.0, 0.165), (0.93, 0.29, 0.125)),
)
RUN = Stride(
    length=2.05,
    lift_off=0.36,
    lead=0.19,
    width=0.045,
    toe_out=4.0,
    pitch=(
        (0.0, -9.0),
        (0.04, 0.0),
        (0.14, 0.0),
        (0.22, 14.0),
        (0.30, 42.0),
        (0.36, 66.0),
        (0.44, 92.0),
        (0.58, 84.0),
        (0.74, 24.0),
        (0.86, -2.0),
        (0.95, -12.0),
    ),
    flight=((0.50, -0.52, 0.44), (0.66, -0.14, 0.41), (0.80, 0.24, 0.30), (0.92, 0.31, 0.15)),
)


def gait_arm(
    phase: Float[np.ndarray, " frames"], *, forward: float, swing: float, elbow: tuple[float, float]
) -> Arm:
    """Swing an arm: foremost at phase 0 (when the other side's foot lands), elbow a little later.

    Args:
        phase: of the arm; half a cycle away from its own side's foot.
        forward: mean angle of the upper arm.
        swing: its amplitude.
        elbow: bend when the arm is behind, and in front.
    """
    ahead, late = wave(phase), wave(phase, 0.06)
    return Arm(
        swing=forward + swing * ahead,
        spread=11.0 + 2.0 * wave(phase, 0.5),
        twist=2.0 + 8.0 * late,
        elbow=elbow[0] + (elbow[1] - elbow[0]) * (late + 1) / 2,
        pronate=14.0 + 6.0 * late,
        wrist=8.0 + 5.0 * wave(phase, 0.15),
        reach=4.0 * ahead,
    )


def walk() -> Posture:
    """Walk at 1.24 m/s: 2 cycles of 32 frames."""
    times = frame_times(CYCLES * 32 / 30)
    phase = times / times[-1] * CYCLES  # the left foot lands at 0, 1, 2
    twice = 2 * phase
    height = STANDING + 0.019 * wave(twice, 0.58)
    hips = columns(
        0.020 * wave(phase, 0.30), height, WALK.length * phase + 0.012 * wave(twice, 0.25)
    )
    yaw = wave(phase, 0.02)
    return settle(
        Posture(
            hips=hips,
            pelvis=columns(-6.5 * yaw, 3.0 + 0.8 * wave(twice, 0.1), 3.8 * wave(phase, 0.16)),
            chest=columns(
                6.5 * wave(phase, 0.04), 2.5 + 1.2 * wave(twice, 0.2), -1.8 * wave(phase, 0.2)
            ),
            head=columns(
                1.2 * wave(phase, 0.1), 1.0 + 0.8 * wave(twice, 0.3), -0.6 * wave(phase, 0.2)
            ),
            left_foot=stride_foot(WALK, phase, "left"),
            right_foot=stride_foot(WALK, phase, "right"),
            left_arm=gait_arm(phase - 0.5, forward=3.0, swing=21.0, elbow=(14.0, 34.0)),
            right_arm=gait_arm(phase, forward=3.0, swing=21.0, elbow=(14.0, 34.0)),
        ),
        limit=0.997,
        loop=True,
    )


def run() -> Posture:
    """Run at 2.9 m/s: 2 cycles of 21 frames, with a flight after each step."""
    times = frame_times(CYCLES * 21 / 30)
    phase = times / times[-1] * CYCLES
    twice = 2 * phase
    height = STANDING + 0.034 * wave(twice, 0.86)
    hips = columns(0.010 * wave(phase, 0.17), height, RUN.length * phase + 0.010 * wave(twice, 0.3))
    return settle(
        Posture(
            hips=hips,
            pelvis=columns(
                -9.0 * wave(phase, 0.0), 9.0 + 2.0 * wave(twice, 0.2), 4.0 * wave(phase, 0.14)
            ),
            chest=columns(
                12.0 * wave(phase, 0.02), 9.0 + 2.0 * wave(twice, 0.3), -2.0 * wave(phase, 0.2)
            ),
            head=columns(
                2.0 * wave(phase, 0.06), 3.0 + 1.5 * wave(twice, 0.5), -0.8 * wave(phase, 0.2)
            ),
            left_foot=stride_foot(RUN, phase, "left"),
            right_foot=stride_foot(RUN, phase, "right"),
            left_arm=gait_arm(phase - 0.5, forward=-13.0, swing=42.0, elbow=(76.0, 104.0)),
            right_arm=gait_arm(phase, forward=-13.0, swing=42.0, elbow=(76.0, 104.0)),
        ),
        limit=0.975,
        loop=True,
    )

"""A dance of eight beats: step and touch to each side, then sway with the arms up."""

import numpy as np
from jaxtyping import Float

from choreography.body import STANDING, Arm, Posture, settle
from choreography.curves import Keys, columns, frame_times, looped, wave
from choreography.feet import Step, stepping
from choreography.standing import BALANCE, EASY

SECONDS = 4.0  # eight beats of half a second
BEATS = 8
LEFT = (
    Step(0.13, 0.44, 0.36, 0.02, 14.0),
    Step(1.56, 1.92, -0.06, 0.03, 8.0, 0.05),
    Step(2.06, 2.42, 0.18, 0.0, 14.0),
    Step(3.58, 3.92, 0.13, 0.0, 12.0, 0.05),
)
RIGHT = (
    Step(0.56, 0.92, 0.14, 0.03, -8.0, 0.05),
    Step(1.06, 1.42, -0.30, 0.02, -14.0),
    Step(2.58, 2.94, -0.20, 0.0, -14.0, 0.05),
    Step(3.08, 3.44, -0.13, 0.0, -12.0, 0.05),
)
PLACE: Keys = (
    *((0.0, 0.0), (0.10, 0.20), (0.22, 0.25), (0.35, -0.17), (0.48, -0.19)),
    *((0.60, 0.06), (0.66, 0.04), (0.74, -0.08), (0.80, -0.05), (0.87, 0.06), (0.94, 0.03)),
)
HIP: Keys = (
    *((0.0, -0.6), (0.10, 1.0), (0.16, 0.3), (0.225, 1.0), (0.35, -1.0), (0.41, -0.3)),
    *((0.475, -1.0), (0.60, 1.0), (0.725, -1.0), (0.85, 1.0), (0.95, -0.4)),
)
RAISED: Keys = ((0.0, 0.0), (0.44, 0.0), (0.535, 1.0), (0.90, 1.0), (0.985, 0.0))


def dance() -> Posture:
    """Dance for eight beats at 120 a minute; the end goes on in the beginning."""
    times = frame_times(SECONDS)
    phase = times / SECONDS
    bounce = wave(phase * BEATS, 0.1)  # 1 is low, a little after the beat
    hip, late = looped(phase, HIP), looped(phase - 0.02, HIP)
    raised = looped(phase, RAISED)
    return settle(
        Posture(
            hips=columns(
                looped(phase, PLACE), STANDING - 0.018 * (bounce + 1), BALANCE + 0.01 * bounce
            ),
            pelvis=columns(8.0 * hip, 3.0 + 2.0 * bounce, 6.0 * hip),
            chest=columns(-10.0 * late, 2.0 + 3.0 * bounce, -5.0 * late),
            head=columns(7.0 * late, 1.0 + 5.0 * bounce, 4.0 * hip),
            left_foot=stepping(times, (0.13, 0.0, 12.0), LEFT),
            right_foot=stepping(times, (-0.13, 0.0, -12.0), RIGHT),
            left_arm=dancing_arm(1.0, bounce, late, raised),
            right_arm=dancing_arm(-1.0, bounce, late, raised),
        ),
        EASY,
        loop=True,
    )


def dancing_arm(
    side: float,
    bounce: Float[np.ndarray, " frames"],
    sway: Float[np.ndarray, " frames"],
    raised: Float[np.ndarray, " frames"],
) -> Arm:
    """Swing an arm across and back with the hips; overhead, bend the one the hips leave.

    Args:
        side: 1 left, -1 right.
        bounce: 1 where the body is low.
        sway: of the hips, 1 to the left.
        raised: 0 with the arms low, 1 with both overhead.
    """
    low, pump = 1.0 - raised, -side * sway
    return Arm(
        swing=low * (8.0 + 26.0 * pump) + 8.0 * raised,
        spread=low * (24.0 - 8.0 * pump + 4.0 * bounce) + raised * (128.0 + 10.0 * pump),
        twist=low * (6.0 + 16.0 * pump) - 30.0 * raised,
        elbow=low * (62.0 + 22.0 * pump) + raised * (40.0 - 22.0 * pump + 8.0 * bounce),
        pronate=20.0,
        wrist=4.0 + 10.0 * pump,
        tilt=6.0 + 10.0 * pump * raised,
        shrug=3.0 * bounce,
    )

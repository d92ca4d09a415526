"""Clips that lower the body or leave the floor: jump, sit down, crouch, kick."""

import dataclasses

import numpy as np
from jaxtyping import Float

from choreography.body import STANDING, Arm, Foot, Posture, lifted, settle
from choreography.curves import columns, frame_times, keyed
from choreography.feet import ANKLE, planted
from choreography.standing import EASY, HALF_WIDTH, TOE_OUT, stance

GRAVITY = 9.81
SEAT = 0.50  # height of the hips on a chair of 0.42 m
Curve = Float[np.ndarray, " frames"]


def jump() -> Posture:
    """Crouch, swing the arms, leave the floor, land on the toes and give way.

    The hips fly on a parabola: take-off and landing speed fit the time in the air.
    """
    times = frame_times(2.3)
    off, on = 0.80, 1.27
    air = on - off
    speed = GRAVITY * air / 2
    top = STANDING + 0.045  # on the toes
    keys = [
        (0.0, 0.0),
        (0.12, 0.004),
        (0.56, -0.27),
        (off - 0.10, top - STANDING - 0.10 * speed * 0.80),
    ]
    return _jumping(times, keys, (off, on, speed, top))


def _jumping(
    times: Curve, keys: list[tuple[float, float]], flight: tuple[float, float, float, float]
) -> Posture:
    off, on, speed, top = flight
    since = np.clip(times - off, 0.0, on - off)
    rise = speed * since - GRAVITY * since**2 / 2
    ground = keyed(
        times,
        [
            *keys,
            (off, top - STANDING),
            (on, top - STANDING),
            (on + 0.055, top - STANDING - 0.12),
            (on + 0.18, -0.235),
            (on + 0.26, -0.225),
            (on + 0.72, 0.006),
            (on + 0.9, 0.0),
        ],
    )
    crouch = keyed(
        times,
        [
            (0.08, 0.0),
            (0.56, 1.0),
            (off, 0.0),
            (on - 0.08, 0.12),
            (on + 0.2, 0.86),
            (on + 0.7, 0.0),
        ],
    )
    heel = keyed(
        times,
        [
            (0.62, 0.0),
            (off, 52.0),
            (off + 0.10, 58.0),
            (on - 0.10, 26.0),
            (on, 24.0),
            (on + 0.09, 0.0),
        ],
    )
    tuck = keyed(times, [(off, 0.0), (off + 0.22, 1.0), (on - 0.06, 0.0)])
    arms = keyed(
        times,
        [
            (0.05, 0.0),
            (0.5, -62.0),
            (0.58, -60.0),
            (off + 0.02, 128.0),
            (off + 0.2, 140.0),
            (on + 0.1, 40.0),
            (on + 0.3, 18.0),
            (on + 0.75, -4.0),
            (on + 0.95, 0.0),
        ],
    )

    def foot(side: str) -> Foot:
        sign = 1.0 if side == "left" else -1.0
        place = columns(sign * HALF_WIDTH + 0.0 * times, 0.0, 0.0)
        standing = planted(place, sign * TOE_OUT, pitch=heel, knee=4.0)
        up = columns(0.0, rise + 0.10 * tuck, -0.08 * tuck)
        toes = standing.toes + np.minimum(heel, 38.0) * 0.7 * np.minimum(rise / 0.06, 1.0)
        return dataclasses.replace(standing, ankle=standing.ankle + up, toes=toes)

    arm = Arm(
        swing=4.0 + arms,
        spread=10.0 + 10.0 * crouch + 8.0 * tuck,
        elbow=16.0 + 16.0 * crouch + 26.0 * tuck,
        shrug=4.0 * tuck,
    )
    return lifted(
        Posture(
            hips=columns(0.0, STANDING - 0.012 + ground + rise, -0.07 * crouch + 0.01 * tuck),
            pelvis=columns(0.0, 1.0 + 32.0 * crouch - 3.0 * tuck, 0.0),
            chest=columns(0.0, 1.0 + 44.0 * crouch - 4.0 * tuck, 0.0),
            head=columns(0.0, 2.0 + 14.0 * crouch - 8.0 * tuck, 0.0),
            left_foot=foot("left"),
            right_foot=foot("right"),
            left_arm=arm,
            right_arm=arm,
        ),
        0.0,
    )


def sit_down() -> Posture:
    """Sit down on a chair of 0.42 m: look, reach back with the hips, lower, lean back, hands on thighs."""
    times = frame_times(3.0)
    down = keyed(times, [(0.25, 0.0), (0.6, 0.10), (1.45, 1.02), (1.62, 0.99), (1.8, 1.0)])
    back = keyed(times, [(0.1, 0.0), (0.3, 0.03), (1.3, 1.0), (1.5, 1.0)])
    lean = keyed(times, [(0.1, 0.0), (0.95, 1.0), (1.2, 0.92), (1.9, -0.06), (2.3, 0.0)])
    late = keyed(times, [(0.2, 0.0), (1.05, 1.0), (1.3, 0.9), (2.05, -0.06), (2.5, 0.0)])
    seated = keyed(times, [(1.0, 0.0), (1.9, 1.0)])
    glance = keyed(times, [(0.0, 0.0), (0.3, 1.0), (0.6, 0.9), (1.0, 0.0)])
    balance = keyed(times, [(0.3, 0.0), (1.0, 1.0), (1.75, 0.0)])

    def arm(sign: float) -> Arm:
        return Arm(
            swing=4.0 + 26.0 * balance + 13.0 * seated - 2.0 * sign * balance,
            spread=10.0 + 8.0 * balance + 4.0 * seated,
            twist=4.0 + 12.0 * seated,
            elbow=16.0 + 16.0 * balance + 46.0 * seated,
            pronate=10.0 + 52.0 * seated,
            wrist=6.0 - 4.0 * seated,
        )

    return settle(
        Posture(
            hips=columns(0.0, STANDING - 0.004 + (SEAT - STANDING) * down, -0.43 * back),
            pelvis=columns(0.0, 1.0 + 34.0 * lean - 9.0 * seated, 0.0),
            chest=columns(-5.0 * glance, 1.0 + 50.0 * late - 2.0 * seated, 0.0),
            head=columns(-22.0 * glance, 2.0 + 22.0 * late + 8.0 * glance + 1.0 * seated, 0.0),
            left_foot=stance(times, "left"),
            right_foot=stance(times, "right"),
            left_arm=arm(1.0),
            right_arm=arm(-1.0),
        ),
        EASY,
    )


def crouch() -> Posture:
    """Go down on the haunches, look left and right, come up again."""
    times = frame_times(3.4)
    down = keyed(
        times, [(0.1, 0.0), (0.85, 1.03), (1.05, 1.0), (2.3, 1.0), (3.1, -0.01), (3.35, 0.0)]
    )
    late = keyed(times, [(0.15, 0.0), (0.92, 1.04), (1.15, 1.0), (2.2, 1.0), (3.0, 0.0)])
    look = keyed(
        times, [(1.0, 0.0), (1.3, 32.0), (1.55, 32.0), (1.9, -34.0), (2.15, -34.0), (2.5, 0.0)]
    )
    heel = 30.0 * keyed(times, [(0.3, 0.0), (0.85, 1.0), (2.45, 1.0), (2.95, 0.0)])
    left, right = (
        planted(columns(x + 0.0 * times, 0.0, z), yaw, pitch=pitch, knee=6.0 * down)
        for x, z, yaw, pitch in ((0.11, 0.05, 12.0, 0.1 * heel), (-0.11, -0.05, -12.0, heel))
    )

    def arm(sign: float) -> Arm:
        return Arm(
            swing=4.0 + 34.0 * late,
            spread=10.0 + 10.0 * late,
            twist=4.0 + 22.0 * late,
            elbow=16.0 + 62.0 * late,
            pronate=10.0 + 30.0 * late,
            wrist=6.0 - 12.0 * late + 0.04 * sign * look,
        )

    return settle(
        Posture(
            hips=columns(0.0, STANDING - 0.004 - 0.47 * down, -0.10 * down),
            pelvis=columns(0.1 * look, 1.0 + 20.0 * down, 0.0),
            chest=columns(0.35 * look, 1.0 + 34.0 * late, 0.0),
            head=columns(look, 2.0 + 4.0 * late, 0.0),
            left_foot=left,
            right_foot=right,
            left_arm=arm(1.0),
            right_arm=arm(-1.0),
        ),
        EASY,
    )


def kick() -> Posture:
    """Kick a ball with the right foot: draw back, swing through, set the foot down again."""
    times = frame_times(2.0)
    ankle = keyed(
        times,
        [
            (0.15, (-HALF_WIDTH, 0.0, 0.0)),
            (0.30, (-HALF_WIDTH, 0.03, -0.08)),
            (0.62, (-0.12, 0.42, -0.46)),
            (0.82, (-0.07, 0.05, 0.10)),
            (0.98, (0.02, 0.48, 0.62)),
            (1.12, (0.03, 0.50, 0.60)),
            (1.50, (-0.09, 0.05, 0.08)),
            (1.68, (-HALF_WIDTH, 0.0, 0.0)),
        ],
    )
    pitch = keyed(
        times,
        [
            (0.12, 0.0),
            (0.3, 30.0),
            (0.62, 78.0),
            (0.82, 38.0),
            (1.0, -28.0),
            (1.14, -22.0),
            (1.5, 6.0),
            (1.68, 0.0),
        ],
    )
    drawn = keyed(times, [(0.1, 0.0), (0.58, 1.0), (0.98, -1.0), (1.12, -0.9), (1.75, 0.0)])
    over = keyed(times, [(0.0, 0.0), (0.26, 1.0), (1.4, 1.0), (1.85, 0.0)])
    dip = keyed(times, [(0.1, 0.0), (0.55, 1.0), (0.98, 0.25), (1.3, 0.5), (1.85, 0.0)])
    turn = columns(-TOE_OUT + 0.0 * times, pitch, 0.0)
    right = Foot(ankle + ANKLE, turn, np.where(pitch > 0, 0.8 * pitch, pitch))
    return settle(
        Posture(
            hips=columns(0.085 * over, STANDING - 0.05 * dip, 0.02 * drawn),
            pelvis=columns(14.0 * -drawn * -1.0, 4.0 + 8.0 * drawn, 4.0 * over),
            chest=columns(-16.0 * drawn, 4.0 + 6.0 * drawn, -5.0 * over),
            head=columns(-2.0 * drawn, 12.0 * over + 2.0, -2.0 * over),
            left_foot=stance(times, "left"),
            right_foot=right,
            left_arm=Arm(
                swing=4.0 + 40.0 * -drawn * -1.0,
                spread=10.0 + 34.0 * over,
                elbow=18.0 + 14.0 * over,
            ),
            right_arm=Arm(
                swing=4.0 - 40.0 * drawn, spread=10.0 + 26.0 * over, elbow=18.0 + 18.0 * over
            ),
        ),
        EASY,
    )

"""Clips that lower the body or leave the floor: jump, sit down, crouch, kick."""

import dataclasses

import numpy as np
from jaxtyping import Float

from choreography.body import STANDING, Arm, Foot, Posture, settle
from choreography.curves import columns, frame_times, keyed, thrown
from choreography.feet import planted
from choreography.standing import BALANCE, EASY, HALF_WIDTH, TOE_OUT, stance

GRAVITY = 9.81
SEAT = 0.50  # height of the hips on a chair of 0.42 m
Curve = Float[np.ndarray, " frames"]


def jump() -> Posture:
    """Crouch, swing the arms, leave the floor, land on the toes and give way.

    The hips fly on a parabola: take-off and landing speed fit the time in the air.
    """
    times = frame_times(2.3)
    off, on, tiptoe = 0.80, 1.27, 0.082
    speed = GRAVITY * (on - off) / 2
    since = np.clip(times - off, 0.0, on - off)
    rise = speed * since - GRAVITY * since**2 / 2
    before = [(0.0, 0.0, 0.0), (0.12, 0.004, 0.0), (0.55, -0.27, 0.0), (off, tiptoe, speed)]
    after = [(on, tiptoe, -speed), (on + 0.2, -0.225, 0.0), (on + 0.74, 0.0, 0.0)]
    ground = np.where(times < (off + on) / 2, thrown(times, before), thrown(times, after))
    heel = keyed(
        times,
        [
            (0.62, 0.0),
            (off, 54.0),
            (off + 0.1, 58.0),
            (on - 0.1, 40.0),
            (on, 38.0),
            (on + 0.1, 0.0),
        ],
    )
    return settle(_jumping(times, (ground, rise, heel), (off, on)), EASY)


def _jumping(
    times: Curve, curves: tuple[Curve, Curve, Curve], flight: tuple[float, float]
) -> Posture:
    """Fold and unfold the body around the flight of a jump."""
    (ground, rise, heel), (off, on) = curves, flight
    tuck = keyed(times, [(off, 0.0), (off + 0.22, 1.0), (on - 0.06, 0.0)])
    crouch = keyed(
        times,
        [(0.06, 0.0), (0.55, 1.0), (off, 0.0), (on - 0.08, 0.1), (on + 0.2, 0.8), (on + 0.72, 0.0)],
    )
    before = [(0.04, 0.0), (0.42, -48.0), (0.48, -48.0), (off, 122.0), (off + 0.16, 150.0)]
    after = [(on + 0.08, 50.0), (on + 0.3, 16.0), (on + 0.75, -4.0), (on + 0.95, 0.0)]
    swing = keyed(times, [*before, *after])
    outward = keyed(times, [(0.0, 0.0), (0.46, 1.0), (off, 0.3), (on + 0.2, 0.8), (on + 0.8, 0.0)])

    def foot(side: str) -> Foot:
        sign = 1.0 if side == "left" else -1.0
        place = columns(sign * HALF_WIDTH + 0.0 * times, 0.0, 0.0)
        standing = planted(place, sign * TOE_OUT, pitch=heel, knee=4.0)
        up = columns(0.0, rise + 0.10 * tuck, -0.08 * tuck)
        toes = standing.toes + np.minimum(heel, 38.0) * 0.7 * np.minimum(rise / 0.06, 1.0)
        return dataclasses.replace(standing, ankle=standing.ankle + up, toes=toes)

    arm = Arm(
        swing=4.0 + swing,
        spread=10.0 + 14.0 * outward,
        twist=4.0 - 10.0 * outward,
        elbow=16.0 + 8.0 * crouch + 22.0 * tuck,
        shrug=4.0 * tuck,
    )
    return Posture(
        hips=columns(0.0, STANDING + ground + rise, BALANCE - 0.07 * crouch + 0.01 * tuck),
        pelvis=columns(0.0, 2.0 + 30.0 * crouch - 3.0 * tuck, 0.0),
        chest=columns(0.0, 2.0 + 42.0 * crouch - 4.0 * tuck, 0.0),
        head=columns(0.0, 2.0 + 14.0 * crouch - 8.0 * tuck, 0.0),
        left_foot=foot("left"),
        right_foot=foot("right"),
        left_arm=arm,
        right_arm=arm,
    )


def sit_down() -> Posture:
    """Sit down on a chair of 0.42 m: glance back, bend, lower the hips, sit up, hands on thighs."""
    times = frame_times(3.0)
    down = keyed(times, [(0.25, 0.0), (0.6, 0.10), (1.45, 1.02), (1.62, 0.99), (1.8, 1.0)])
    back = keyed(times, [(0.1, 0.0), (0.3, 0.03), (1.3, 1.0), (1.5, 1.0)])
    lean = keyed(times, [(0.1, 0.0), (0.95, 1.0), (1.2, 0.92), (1.9, -0.06), (2.3, 0.0)])
    late = keyed(times, [(0.15, 0.0), (0.9, 1.0), (1.15, 0.9), (1.95, -0.06), (2.4, 0.0)])
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
            hips=columns(0.0, STANDING - 0.004 + (SEAT - STANDING) * down, BALANCE - 0.43 * back),
            pelvis=columns(0.0, 2.0 + 34.0 * lean - 9.0 * seated, 0.0),
            chest=columns(-5.0 * glance, 2.0 + 40.0 * late - 2.0 * seated, 0.0),
            head=columns(-22.0 * glance, 2.0 + 14.0 * late + 8.0 * glance + 1.0 * seated, 0.0),
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
            hips=columns(0.0, STANDING - 0.004 - 0.47 * down, BALANCE - 0.10 * down),
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
    path = [(0.20, 0.0, 0.0, 0.0), (0.36, -0.01, 0.09, -0.08), (0.62, -0.02, 0.27, -0.56)]
    path += [(0.82, 0.03, 0.07, 0.03), (0.98, 0.12, 0.38, 0.72), (1.12, 0.13, 0.42, 0.70)]
    path += [(1.46, 0.02, 0.09, 0.10), (1.70, 0.0, 0.0, 0.0)]
    place = keyed(times, [(at, point) for at, *point in path]) - [HALF_WIDTH, 0.0, 0.0]
    roll = [(0.12, 0.0), (0.3, 30.0), (0.62, 78.0), (0.82, 30.0), (1.0, -28.0), (1.14, -22.0)]
    pitch = keyed(times, [*roll, (1.5, 6.0), (1.72, 0.0)])
    drawn = keyed(times, [(0.1, 0.0), (0.58, 1.0), (0.98, -1.0), (1.12, -0.9), (1.75, 0.0)])
    over = keyed(times, [(0.0, 0.0), (0.26, 1.0), (1.4, 1.0), (1.85, 0.0)])
    dip = keyed(times, [(0.1, 0.0), (0.55, 1.0), (0.98, 0.25), (1.3, 0.5), (1.85, 0.0)])
    right = planted(place, -TOE_OUT, pitch=pitch)
    limp = np.where(pitch > 0, 0.7 * pitch * np.clip(place[:, 1] / 0.1, 0.0, 1.0), pitch)
    right = dataclasses.replace(right, toes=limp)
    return settle(
        Posture(
            hips=columns(0.085 * over, STANDING - 0.05 * dip, BALANCE + 0.02 * drawn),
            pelvis=columns(14.0 * drawn, 4.0 + 8.0 * drawn, 4.0 * over),
            chest=columns(-16.0 * drawn, 4.0 + 6.0 * drawn, -5.0 * over),
            head=columns(-2.0 * drawn, 12.0 * over + 2.0, -2.0 * over),
            left_foot=stance(times, "left"),
            right_foot=right,
            left_arm=Arm(
                swing=4.0 + 40.0 * drawn,
                spread=10.0 + 34.0 * over,
                elbow=18.0 + 14.0 * over,
            ),
            right_arm=Arm(
                swing=4.0 - 40.0 * drawn, spread=10.0 + 26.0 * over, elbow=18.0 + 18.0 * over
            ),
        ),
        EASY,
    )

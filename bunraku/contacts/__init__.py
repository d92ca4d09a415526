"""What touches what: planted feet stay planted, and hands stay out of the body."""

from bunraku.contacts.clearance import (
    Arm,
    Dressed,
    choose_moments,
    choose_swing,
    find_arms,
    swing_arm,
)
from bunraku.contacts.legs import Leg, find_legs
from bunraku.contacts.planting import Performed, plant_feet

__all__ = [
    "Arm",
    "Dressed",
    "Leg",
    "Performed",
    "choose_moments",
    "choose_swing",
    "find_arms",
    "find_legs",
    "plant_feet",
    "swing_arm",
]

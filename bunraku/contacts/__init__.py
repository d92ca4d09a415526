"""Keep planted feet planted: legs found in a rig, contacts in its clips, solved on the figure."""

from bunraku.contacts.legs import Leg, find_legs
from bunraku.contacts.planting import Performed, plant_feet

__all__ = ["Leg", "Performed", "find_legs", "plant_feet"]

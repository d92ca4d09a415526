"""Humans of any make: which joint is which, and motion from one onto another."""

from bunraku.humanoids.naming import name_joints
from bunraku.humanoids.transfer import transfer_motion

__all__ = ["name_joints", "transfer_motion"]

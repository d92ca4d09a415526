"""Bring a figure into the source's rest pose ([IE] Sec. 4.2), and tell its pose from its shape."""

from bunraku.reposing.decision import Reposed, repose
from bunraku.reposing.energy import recover_rest_pose
from bunraku.reposing.symmetry import symmetry_axis

__all__ = ["Reposed", "recover_rest_pose", "repose", "symmetry_axis"]

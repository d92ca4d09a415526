"""A closed one-part stand-in of fixed size for any figure, and the way back to the figure."""

from bunraku.proxy.building import Proxy, build_proxy
from bunraku.proxy.lifting import lift, lift_weights

__all__ = ["Proxy", "build_proxy", "lift", "lift_weights"]

"""Curves through keys, as an animator draws them; angles are in degrees throughout choreography."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

RATE = 30.0
Keys = Sequence[tuple[float, float | Sequence[float]]]


def frame_times(seconds: float) -> Float[np.ndarray, " frames"]:
    """Give the time of every frame of a clip that lasts so long, both ends included."""
    return np.arange(round(seconds * RATE) + 1) / RATE


def keyed(times: Float[np.ndarray, " frames"], keys: Keys) -> Float[np.ndarray, "frames *values"]:
    """Draw a curve through (time, value) keys that is flat at its peaks and never overshoots.

    Before the first and after the last key it holds their value.
    """
    at = np.array([key[0] for key in keys])
    values = np.array([key[1] for key in keys], np.float64)
    at = np.concatenate([[at[0] - 1.0], at, [at[-1] + 1.0]])  # so that it starts and ends flat
    values = np.concatenate([values[:1], values, values[-1:]])
    return PchipInterpolator(at, values)(np.clip(times, at[0], at[-1]))


def thrown(
    times: Float[np.ndarray, " frames"], keys: Sequence[tuple[float, float, float]]
) -> Float[np.ndarray, " frames"]:
    """Draw a curve through (time, value, velocity) keys; it holds its value outside them."""
    at, values, speeds = np.array(keys).T
    return CubicHermiteSpline(at, values, speeds)(np.clip(times, at[0], at[-1]))


def looped(phases: Float[np.ndarray, " frames"], keys: Keys) -> Float[np.ndarray, "frames *values"]:
    """Draw such a curve through keys in [0, 1) that repeats with period 1."""
    around = [(at + turn, value) for turn in (-1, 0, 1) for at, value in keys]
    return keyed(np.mod(phases, 1.0), around)


def wave(phases: Float[np.ndarray, " frames"], peak: float = 0.0) -> Float[np.ndarray, " frames"]:
    """Give a cosine of period 1 that is 1 at phase `peak`."""
    return np.cos(2 * np.pi * (phases - peak))


def columns(*values: Float[np.ndarray, " frames"] | float) -> Float[np.ndarray, "frames columns"]:
    """Stack curves and constants as the columns of one array."""
    return np.stack(np.broadcast_arrays(*values), axis=-1).astype(np.float64)

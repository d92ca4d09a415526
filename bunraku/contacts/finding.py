"""Find when feet are planted: low, and still against the ground, in a source's clip."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import label

LOW, STAY_LOW = 0.025, 0.05  # heights above the ground at which a contact begins, and ends
SLOW, STAY_SLOW = 0.25, 0.5  # heights per second, the same
DRIFT = 0.15  # of the ground's own speed, added to both
AFLOAT = 0.1  # heights: lowest feet farther from their rest than this touch no ground
STILLEST = 0.05  # heights per second: slower soles of a foot are believed before faster ones
LEAST_STILL = 0.3  # share of low moments that are still, above which the ground stands still
LEAST_CARRIED = 0.5  # share that moves as one, below which no treadmill runs


@dataclass(frozen=True, eq=False)
class Contacts:
    """When the soles of one foot are planted, and how far to believe each."""

    numbers: Int[np.ndarray, "frames soles"]  # 0 free, the same number all through one contact
    stillness: Float[np.ndarray, "frames soles"]  # 1 at rest against the ground, falls with speed

    @property
    def touching(self) -> Bool[np.ndarray, " frames"]:
        """Whether any sole is planted."""
        return np.asarray(self.numbers.any(axis=1))


def find_contacts(
    soles: Float[np.ndarray, "frames soles 3"],
    rest_heights: Float[np.ndarray, " soles"],
    times: Float[np.ndarray, " frames"],
    height: float,
    *,
    bearing: Bool[np.ndarray, " frames"] | None = None,
) -> Contacts:
    """Find when each sole of a foot is planted.

    A contact begins where a sole is low and slow, and lasts while it is nearly so (hysteresis).
    The ground may move: in a walk on the spot the planted feet glide backwards as one. While a
    foot rolls over its ball the ankle is nearly planted too: the stiller sole counts for more.

    Args:
        soles: the joints that touch the ground, through the source's clip, in metres.
        rest_heights: theirs in the rest pose.
        times: of the frames, in seconds.
        height: of the source.
        bearing: whether the leg stands under the body, which may also lie or sit; None for always.
    """
    frames, count = soles.shape[:2]
    free = Contacts(np.zeros((frames, count), np.int64), np.ones((frames, count)))
    if frames < 3 or not count or height <= 0:
        return free
    above = (soles[..., 1] - rest_heights) / height
    floor = float(np.percentile(above.min(axis=1), 2))
    if abs(floor) > AFLOAT:
        return free
    above = above - floor
    velocity = np.diff(soles, axis=0) / np.diff(times)[:, None, None] / height
    highest = np.maximum(above[:-1], above[1:])
    if bearing is not None:
        highest[~(bearing[:-1] & bearing[1:])] = np.inf
    ground = ground_velocity(velocity, highest < LOW)
    speed = np.linalg.norm(velocity - ground, axis=-1)
    drift = DRIFT * float(np.linalg.norm(ground))
    begins = (highest < LOW) & (speed < SLOW + drift)
    lasts = (highest < STAY_LOW) & (speed < STAY_SLOW + drift)
    steps = runs_with(lasts, begins)
    numbers = np.maximum(np.pad(steps, ((0, 1), (0, 0))), np.pad(steps, ((1, 0), (0, 0))))
    padded = np.pad(speed, ((1, 1), (0, 0)), mode="edge")
    slower = np.minimum(padded[:-1], padded[1:]) / (STILLEST + drift)
    return Contacts(numbers, 1.0 / (1.0 + slower**2))


def ground_velocity(
    velocity: Float[np.ndarray, "steps soles 3"], low: Bool[np.ndarray, "steps soles"]
) -> Float[np.ndarray, "3"]:
    """Tell how the ground moves under low feet, in heights per second: not, or as a treadmill."""
    carried = velocity[low] * [1.0, 0.0, 1.0]
    if not len(carried) or (np.linalg.norm(carried, axis=1) < SLOW).mean() > LEAST_STILL:
        return np.zeros(3)
    middle = np.median(carried, axis=0)
    allowed = SLOW + DRIFT * float(np.linalg.norm(middle))
    together = (np.linalg.norm(carried - middle, axis=1) < allowed).mean()
    return np.asarray(middle) if together > LEAST_CARRIED else np.zeros(3)


def runs_with(
    lasts: Bool[np.ndarray, "steps soles"], begins: Bool[np.ndarray, "steps soles"]
) -> Int[np.ndarray, "steps soles"]:
    """Number the runs of `lasts` down each column that hold a `begins`; 0 elsewhere."""
    along = np.array([[0, 1, 0], [0, 1, 0], [0, 1, 0]])
    runs, _ = label(lasts, structure=along)
    kept = np.unique(runs[begins & lasts])
    return np.where(np.isin(runs, kept), runs, 0).astype(np.int64)

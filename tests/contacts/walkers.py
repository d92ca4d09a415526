"""A walker of two legs, each of thigh, shank and foot, hung on hips; facing +Z, 1 m high."""

import numpy as np

from bunraku.contacts import Leg

NAMES = ("hips", "thighL", "shankL", "footL", "toesL", "thighR", "shankR", "footR", "toesR")
PARENTS = np.array([-1, 0, 1, 2, 3, 0, 5, 6, 7])
SIDE = np.array([[0.1, 0.5, 0.0], [0.1, 0.28, 0.03], [0.1, 0.06, 0.0], [0.1, 0.02, 0.1]])
JOINTS = np.vstack([[[0.0, 0.52, 0.0]], SIDE, SIDE * [-1.0, 1.0, 1.0]])


def surface() -> tuple[np.ndarray, np.ndarray]:
    """Give points of a body and their skin: a head on the hips, soles under feet and toes."""
    points = np.vstack([JOINTS, JOINTS[[3, 4, 7, 8]] * [1.0, 0.0, 1.0], [[0.0, 1.0, 0.0]]])
    owners = np.array([*range(9), 3, 4, 7, 8, 0])
    return points, np.eye(9)[owners]


def legs_of() -> tuple[Leg, Leg]:
    """Give the legs as they should be found."""
    left = Leg(1, 2, 3, np.array([1]), np.array([2]), np.array([3, 4]), np.array([3, 4]))
    right = Leg(5, 6, 7, np.array([5]), np.array([6]), np.array([7, 8]), np.array([7, 8]))
    return left, right

"""Axes along and across a direction."""

import numpy as np

from navcore.arrays import Floats, Vectors


def along_first(direction: Vectors) -> Floats:
    """(3, 3) a rotation whose first row is the unit vector given."""
    side = np.cross(direction, np.eye(3)[int(np.argmin(np.abs(direction)))])
    side /= np.linalg.norm(side)
    return np.stack([direction, side, np.cross(direction, side)])


def for_both(R: Floats) -> Floats:
    """(6, 6) that turns gyroscope and accelerometer alike, from (3, 3)."""
    return np.asarray(np.kron(np.eye(2), R), dtype=np.float64)

"""Directions all around."""

import numpy as np
from scipy.spatial.transform import Rotation

from navcore.arrays import Vectors

_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def evenly(n: int, rng: np.random.Generator) -> Vectors:
    """(n, 3) unit vectors spread evenly over the sphere (Fibonacci's lattice), turned at random."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = _GOLDEN_ANGLE * np.arange(n)
    radius = np.sqrt(1.0 - z * z)
    lattice = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    turned: Vectors = lattice @ Rotation.random(rng=rng).as_matrix().T
    return turned

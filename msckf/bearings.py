"""Directions, and what lies across them."""

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors


def tangents(rays: Vectors) -> Floats:
    """Two unit vectors at right angles to each other and to unit rays (..., 3), as columns (..., 3, 2)."""
    helper = np.where(np.abs(rays[..., :1]) < 0.7, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    first = so3.cross(helper, rays)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, so3.cross(rays, first)], axis=-1)


def across_and_along(rays: Vectors) -> Rotations:
    """Rotations (..., 3, 3) whose last column is the ray (..., 3)."""
    return np.concatenate([tangents(rays), rays[..., None]], axis=-1)

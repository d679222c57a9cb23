"""Light on the surfaces of a room, worked out once: lamps, distance, angle, and what stands in the way."""

import numpy as np

from navcore.arrays import Floats, Vectors
from sim.world.layout import Layout

_AMBIENT = 0.35  # share of the mean irradiance that comes from everywhere
_LAMP_SIZE = 0.3  # m, half width of the square from which a lamp shines: soft shadow edges
_NEAR = 0.6  # m, softens the hot spot beside a lamp


def irradiance(layout: Layout, points: Vectors, normals: Vectors) -> Floats:
    """Relative irradiance (N,), mean 1, at points (N, 3) m with normals (N, 3): lamps, shadows, ambient."""
    total = np.zeros(len(points))
    for lamp in layout.lamps():
        for dx in (-0.5, 0.5):
            for dy in (-0.5, 0.5):
                ray = lamp + _LAMP_SIZE * np.array([dx, dy, 0.0]) - points
                distance = np.linalg.norm(ray, axis=1)
                cosine = np.maximum(np.sum(ray * normals, axis=1) / distance, 0.0)
                lit = cosine / (distance**2 + _NEAR**2)
                shone = lit > 0.0
                start = points[shone] + 1e-4 * normals[shone]
                direction = ray[shone] / distance[shone, None]
                lit[shone] *= layout.clutter_distance(start, direction) > distance[shone] - 1e-3
                total += lit
    mean = float(total.mean())
    relative: Floats = (1.0 - _AMBIENT) * total / mean + _AMBIENT if mean > 0.0 else np.ones(len(points))
    return relative

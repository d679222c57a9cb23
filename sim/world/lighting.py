"""Light on the surfaces of a world, worked out once: lamps or a sun, distance, angle, and what stands in the way."""

import numpy as np

from navcore.arrays import Floats, Mask, Vectors
from sim.world.block import Block, first_hit
from sim.world.layout import Layout

_AMBIENT = 0.35  # share of the mean irradiance that comes from everywhere
_ALWAYS = 0.2  # of it, also when all lamps are out: some light comes through windows and doors
_LAMP_SIZE = 0.3  # m, half width of the square from which a lamp shines: soft shadow edges
_NEAR = 0.6  # m, softens the hot spot beside a lamp
_SKYLIGHT = 0.15  # of the sun's, on a wall; a floor sees twice as much sky


def direct(layout: Layout, points: Vectors, normals: Vectors) -> Floats:
    """Irradiance (L, N), in a unit of its own, by each lamp, at points (N, 3) m with normals (N, 3).

    A layout with a sun has that one light instead, its sky included.
    """
    if layout.sun is not None:
        return _sunlight(layout, np.array(layout.sun), points, normals)[None]
    return np.array([_lamplight(layout, lamp, points, normals) for lamp in layout.lamps()]).reshape(-1, len(points))


def irradiance(relative: Floats, on: Mask) -> Floats:
    """(...) of all light together, from that of each lamp alone (L, ...) and whether it is on (L,).

    `relative` is `direct` over its mean over the world when all are on; then the mean of the result is 1.
    """
    if len(on) == 0:
        return np.ones(relative.shape[1:])
    ambient = _AMBIENT * (_ALWAYS + (1.0 - _ALWAYS) * float(on.mean()))
    total: Floats = (1.0 - _AMBIENT) * relative[on].sum(axis=0) + ambient
    return total


def _lamplight(layout: Layout, lamp: Vectors, points: Vectors, normals: Vectors) -> Floats:
    corners = lamp + _LAMP_SIZE * np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5, 0.5)])
    blocks = _between(layout, points, corners)
    ray = (corners[:, None] - points).reshape(-1, 3)
    distance = np.sqrt(np.einsum("ij,ij->i", ray, ray))
    direction = ray / distance[:, None]
    cosine = np.maximum(np.einsum("kij,ij->ki", direction.reshape(4, -1, 3), normals).ravel(), 0.0)
    lit = cosine / (distance**2 + _NEAR**2)
    shone = lit > 0.0
    start = (points + 1e-4 * normals)[np.flatnonzero(shone) % len(points)]
    lit[shone] *= first_hit(blocks, start, direction[shone]) > distance[shone] - 1e-3
    total: Floats = lit.reshape(4, -1).sum(axis=0)
    return total


def _sunlight(layout: Layout, sun: Vectors, points: Vectors, normals: Vectors) -> Floats:
    blocks = _between(layout, points, points + layout.diagonal * sun)
    lit: Floats = np.maximum(normals @ sun, 0.0)
    shone = lit > 0.0
    start = points[shone] + 1e-4 * normals[shone]
    lit[shone] *= np.isinf(first_hit(blocks, start, np.tile(sun, (len(start), 1))))
    return lit + _SKYLIGHT * (1.0 + normals[:, 2])


def _between(layout: Layout, points: Vectors, ends: Vectors) -> list[Block]:
    """Those blocks that can be in the way from points to ends: the others need not be tried."""
    low, high = np.minimum(points.min(axis=0), ends.min(axis=0)), np.maximum(points.max(axis=0), ends.max(axis=0))
    lows, highs = layout.corners
    return [layout.blocks[k] for k in np.flatnonzero(np.all((lows <= high) & (highs >= low), axis=1))]

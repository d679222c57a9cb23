"""Solid boxes, and how far things are from them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Vectors
from sim.world.look import PAINTED, Look

Triple = tuple[float, float, float]
"""x, y, z [m] in W."""


@dataclass(frozen=True)
class Block:
    """A solid box, axis-aligned: centre and half sizes [m] in W, and the look of its sides."""

    centre: Triple
    half: Triple
    look: Look = PAINTED

    @staticmethod
    def between(low: Iterable[float], high: Iterable[float], look: Look = PAINTED) -> "Block":
        """The box from a corner to the opposite one."""
        a, b = np.array([*low]), np.array([*high])
        return Block(triple(0.5 * (a + b)), triple(0.5 * (b - a)), look)

    @property
    def low(self) -> Vectors:
        """(3,) m."""
        return np.array(self.centre) - self.half

    @property
    def high(self) -> Vectors:
        """(3,) m."""
        return np.array(self.centre) + self.half


def triple(values: Iterable[float]) -> Triple:
    """Three numbers as a tuple."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def gaps(points: Vectors, low: Vectors, high: Vectors) -> Floats:
    """(N,) m: how far points (N, 3) are from the box between two corners (3,); zero inside."""
    outside = np.maximum(np.maximum(low - points, points - high), 0.0)
    distance: Floats = np.linalg.norm(outside, axis=1)
    return distance


def first_hit(blocks: Iterable[Block], start: Vectors, direction: Vectors) -> Floats:
    """(N,) m: how far rays from (N, 3) m along unit directions (N, 3) go until they enter a block, or infinity."""
    nearest = np.full(len(start), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / direction
        for block in blocks:
            a = (np.array(block.centre) - block.half - start) * inverse
            b = (np.array(block.centre) + block.half - start) * inverse
            enter, leave = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
            hit = (enter < leave) & (enter > 0.0)
            nearest = np.where(hit, np.minimum(nearest, enter), nearest)
    return nearest

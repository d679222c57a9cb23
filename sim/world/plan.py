"""A world in the making: what fits is put into it."""

import numpy as np

from navcore.arrays import Vectors
from sim.world.block import Block, Triple, triple
from sim.world.layout import LAMP_HALF
from sim.world.way import CLEARANCE, Way

_APART = 0.02  # m between things, so that no two surfaces coincide


class Plan:
    """The box that encloses a world, and the blocks in it so far."""

    def __init__(self, way: Way, low: Vectors, high: Vectors) -> None:
        """For a box between two corners (3,) m."""
        self.way, self.low, self.high = way, np.asarray(low), np.asarray(high)
        self.blocks: list[Block] = []
        self.lamps: list[Triple] = []

    def put(self, *group: Block) -> bool:
        """Add blocks that belong together if all lie in the box, clear of the path and of all blocks before."""
        fits = all(self._holds(b) and self.way.clear_of(b) and not self._meets(b) for b in group)
        if fits:
            self.blocks += group
        return fits

    def hang_lamp(self, x: float, y: float) -> bool:
        """Hang a lamp under the ceiling if it is clear of the path."""
        lamp = Block(triple((x, y, self.high[2] - LAMP_HALF[2])), LAMP_HALF)
        fits = self.way.clear_of(lamp)
        if fits:
            self.blocks.append(lamp)
            self.lamps.append(triple((x, y, lamp.low[2])))
        return fits

    def near(self, rng: np.random.Generator, reach: tuple[float, float]) -> tuple[float, float]:
        """x, y [m] of a place beside a random point of the path, `reach` (least, most) m past the clearance."""
        point = self.way.points[rng.integers(len(self.way.points))]
        angle, distance = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(CLEARANCE + reach[0], CLEARANCE + reach[1])
        return float(point[0] + distance * np.cos(angle)), float(point[1] + distance * np.sin(angle))

    def anywhere(self, rng: np.random.Generator) -> tuple[float, float]:
        """x, y [m] of a place in the box."""
        x, y = rng.uniform(self.low[:2], self.high[:2])
        return float(x), float(y)

    def _holds(self, block: Block) -> bool:
        return bool(np.all(block.low >= self.low - 1e-9) and np.all(block.high <= self.high + 1e-9))

    def _meets(self, block: Block) -> bool:
        low, high = block.low - _APART, block.high + _APART
        low[2], high[2] = block.low[2] + 1e-6, block.high[2] - 1e-6  # things may stand on each other
        return any(np.all(b.low < high) and np.all(b.high > low) for b in self.blocks)

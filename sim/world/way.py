"""Where the body goes, and what stands clear of it."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Vectors
from sim.errors import ConfigError
from sim.world.block import Block, gaps

CLEARANCE = 0.6
"""How far clutter keeps from the body [m]."""

_STEP = 0.05  # m between the points that are kept of a path
_LOWEST_ON_FLOOR = 1.8  # m: a path that comes no lower begins on the floor, on a table or in a hand
_BELOW = 0.8  # m, of the floor below any other path


@dataclass(frozen=True)
class Way:
    """A path, thinned.

    Attributes:
        points: (P, 3) m in W, 5 cm apart.
    """

    points: Vectors

    @staticmethod
    def of(path: Vectors) -> "Way":
        """The way along a path (N, 3) m.

        Raises:
            ConfigError: there is no point, or one that is not finite.
        """
        path = np.asarray(path, dtype=np.float64)
        if path.ndim != 2 or path.shape[1:] != (3,) or len(path) == 0 or not np.isfinite(path).all():
            raise ConfigError(f"a scene needs a path of finite points (N, 3), got shape {path.shape}")
        gone = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        points = path[np.unique(np.floor(gone / _STEP), return_index=True)[1]]
        points.setflags(write=False)
        return Way(points)

    @property
    def low(self) -> Vectors:
        """(3,) m."""
        lowest: Vectors = self.points.min(axis=0)
        return lowest

    @property
    def high(self) -> Vectors:
        """(3,) m."""
        highest: Vectors = self.points.max(axis=0)
        return highest

    @property
    def floor(self) -> float:
        """Height of the floor [m]: 0 if the path seems to be measured from it."""
        lowest = float(self.low[2])
        return 0.0 if 0.0 <= lowest <= _LOWEST_ON_FLOOR else lowest - _BELOW

    def clear_of(self, block: Block, clearance: float = CLEARANCE) -> bool:
        """Whether the body keeps so far from a block [m]."""
        return bool(gaps(self.points, block.low, block.high).min() >= clearance + 0.5 * _STEP)

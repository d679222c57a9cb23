"""Corners worth following, spread over the image."""

import cv2
import numpy as np

from navcore.arrays import Mask, Pixels, Stamps
from navcore.tracker.config import TrackerConfig
from navcore.tracker.exposure import Exposed


class Grid:
    """Cells over an image, each of which gets its share of features."""

    def __init__(self, width: int, height: int, config: TrackerConfig) -> None:
        self.columns, self.rows = config.grid
        self.size = self.columns * self.rows
        self.share = -(-config.max_features // self.size)
        self._cell = np.array([width / self.columns, height / self.rows])
        self._last = np.array([self.columns - 1, self.rows - 1])

    def cells(self, uv: Pixels) -> Stamps:
        """(N,) in which cell pixels (N, 2) lie."""
        at = np.clip((uv / self._cell).astype(np.int64), 0, self._last)
        return np.asarray(at[:, 1] * self.columns + at[:, 0])

    def counts(self, uv: Pixels) -> Stamps:
        """(cells,) how many of the pixels (N, 2) lie in each."""
        return np.bincount(self.cells(uv), minlength=self.size)


def find_corners(
    exposed: Exposed, taken: Pixels, wanted: Stamps, most: int, grid: Grid, config: TrackerConfig
) -> Pixels:
    """The strongest corners (Shi and Tomasi 1994), those of the emptiest cells first.

    They are looked for in the image at half size: what is left there is larger than the noise.

    Args:
        exposed: the image.
        taken: (N, 2) px, features that are there already; corners keep their distance from them and from each other.
        wanted: (cells,) how many each cell can take.
        most: how many may be found in all.
        grid: the cells.
        config: settings.

    Returns:
        (M, 2) px.
    """
    h, w = exposed.half.shape
    strength = cv2.cornerMinEigenVal(exposed.half, 3)
    around = np.ones((2 * (config.min_distance // 2) + 1,) * 2, dtype=np.uint8)
    blocked = np.zeros((h, w), dtype=np.uint8)
    at = np.clip(np.round(taken / 2.0).astype(np.int64), 0, [w - 1, h - 1])
    blocked[at[:, 1], at[:, 0]] = 1
    strength *= 1 - cv2.dilate(blocked, around)
    edge = (config.border + 2) // 2
    peak = np.zeros((h, w), dtype=bool)
    inner = np.s_[edge : h - edge, edge : w - edge]
    floor = config.strength / exposed.gain**2
    peak[inner] = (strength == cv2.dilate(strength, around))[inner] & (strength > floor)[inner]
    v, u = np.divmod(np.flatnonzero(peak), w)
    order = np.argsort(-strength[v, u], kind="stable")
    uv: Pixels = 2.0 * np.column_stack([u[order], v[order]]).astype(np.float64)
    cells = grid.cells(uv)
    rank = _rank(cells, grid.size)
    fits = np.flatnonzero(rank < wanted[cells])
    emptiest = np.argsort((rank - wanted[cells])[fits], kind="stable")
    return uv[fits[emptiest][: max(0, most)]]


def _rank(cells: Stamps, size: int) -> Stamps:
    """(N,) how many of the same cell come before each."""
    by_cell = np.argsort(cells, kind="stable")
    first = np.searchsorted(cells[by_cell], np.arange(size))
    rank = np.empty(len(cells), dtype=np.int64)
    rank[by_cell] = np.arange(len(cells)) - first[cells[by_cell]]
    return rank


def apart(uv: Pixels, others: Pixels, distance: float) -> Mask:
    """(N,) which of the pixels (N, 2) are farther than `distance` from all others (M, 2)."""
    if len(others) == 0:
        return np.ones(len(uv), dtype=bool)
    squared = ((uv[:, None] - others) ** 2).sum(axis=2)
    return np.asarray((squared > distance**2).all(axis=1))

"""The features that a tracker follows, among points that it might see."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from navcore.arrays import Mask, Stamps
from sim.points.outline import CELLS
from sim.points.view import Seen

_JUMP_S = 0.3  # mean time until a mismatched feature jumps again


@dataclass
class Followed:
    """Which points are followed.

    Attributes:
        next_id: gives the ids of new features.
        which: (N,) the points.
        ids: (N,) of the features on them.
        wrong: (N,) whether a feature has left the point that it began on.
    """

    next_id: Iterator[int]
    which: Stamps
    ids: Stamps
    wrong: Mask

    @staticmethod
    def none(next_id: Iterator[int]) -> "Followed":
        """Nothing, to begin with."""
        return Followed(next_id, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool))

    def lose(self, seen: Seen, wanted: int, hazard: float, rng: np.random.Generator) -> None:
        """Lose what is out of view, others with probability 1 - exp(-hazard), and any beyond `wanted`."""
        kept = rng.random(len(self.which)) < np.exp(-hazard)
        self.keep(kept & seen.may[self.which])
        if len(self.which) > wanted:
            self.keep(rng.permutation(len(self.which)) < wanted)

    def mismatch(self, seen: Seen, n: int, period_s: float, rng: np.random.Generator) -> None:
        """Let `n` of the features follow, under their old ids, points that are near the last ones in the image.

        They jump again after .3 s in the mean, so that a mismatch never becomes a good feature.
        """
        right = np.flatnonzero(~self.wrong)
        short = min(n - int(np.count_nonzero(self.wrong)), len(right))
        jumping = self.wrong & (rng.random(len(self.wrong)) < period_s / _JUMP_S)
        if short > 0:
            jumping[rng.choice(right, short, replace=False)] = True
        if not jumping.any():
            return
        cell_of = np.full(len(seen.may), -1)
        cell_of[seen.which] = seen.cells
        jumpers, jump_rank = _by_cell(np.flatnonzero(jumping), cell_of[self.which])
        free, _ = _by_cell(rng.permutation(self._free(seen)), seen.cells)
        cells = np.append(seen.cells[free], CELLS)
        # The n-th feature that jumps within a cell takes the n-th free point there, if there are so many.
        from_cell = cell_of[self.which[jumpers]]
        place = np.minimum(np.searchsorted(cells, from_cell) + jump_rank, len(free))
        lands = cells[place] == from_cell
        self.which[jumpers[lands]] = seen.which[free[place[lands]]]
        self.wrong[jumpers[lands]] = True

    def keep(self, kept: Mask) -> None:
        """Lose the others."""
        self.which, self.ids, self.wrong = self.which[kept], self.ids[kept], self.wrong[kept]

    def drop(self) -> None:
        """Lose them all."""
        self.keep(np.zeros(len(self.which), dtype=bool))

    def fill(self, seen: Seen, wanted: int, rng: np.random.Generator) -> None:
        """Up to `wanted` features, with new ones in the cells of the image that hold the fewest."""
        n = wanted - len(self.which)
        if n <= 0:
            return
        free = rng.permutation(self._free(seen))
        load = np.bincount(seen.cells, minlength=CELLS) - np.bincount(seen.cells[free], minlength=CELLS)
        order, rank = _by_cell(free, seen.cells)
        best = np.argsort(load[seen.cells[order]] + rank, kind="stable")[:n]
        new = seen.which[order[best]]
        self.which = np.concatenate([self.which, new])
        self.ids = np.concatenate([self.ids, np.fromiter(self.next_id, dtype=np.int64, count=len(new))])
        self.wrong = np.concatenate([self.wrong, np.zeros(len(new), dtype=bool)])

    def _free(self, seen: Seen) -> Stamps:
        """Which of the points in the image no feature follows, as indices of `seen.which`."""
        is_followed = np.zeros(len(seen.may), dtype=bool)
        is_followed[self.which] = True
        return np.flatnonzero(~is_followed[seen.which])


def _by_cell(items: Stamps, cells: Stamps) -> tuple[Stamps, Stamps]:
    """Items (N,), as indices of `cells`, in the order of their cells, and the rank (N,) of each in its cell."""
    order = items[np.argsort(cells[items], kind="stable")]
    in_order = cells[order]
    rank: Stamps = np.arange(len(order)) - np.searchsorted(in_order, in_order)
    return order, rank

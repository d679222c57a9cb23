"""Observations of features over the window of clones, as dense arrays."""

import numpy as np

from navcore.arrays import Floats, Mask, Stamps


class FeatureTable:
    """Which feature was seen where from which clone; columns follow the filter's clones.

    Attributes:
        keys: (F,) feature number, unique over cameras; sorted.
        cameras: (F,) camera index.
        uv: (F, K, 2) px; bearings: (F, K, 3) the same as unit vectors in C.
        seen: (F, K).
        alive: (F,) whether the newest frame saw it.
    """

    def __init__(self) -> None:
        self.keys: Stamps = np.zeros(0, dtype=np.int64)
        self.cameras: Stamps = np.zeros(0, dtype=np.int64)
        self._seen_at: Floats = np.zeros((0, 0, 5))
        self.seen: Mask = np.zeros((0, 0), dtype=bool)
        self.alive: Mask = np.zeros(0, dtype=bool)

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def uv(self) -> Floats:
        """(F, K, 2) px."""
        return self._seen_at[..., :2]

    @property
    def bearings(self) -> Floats:
        """(F, K, 3) unit vectors in C."""
        return self._seen_at[..., 2:]

    @property
    def views(self) -> Stamps:
        """(F,) how many clones saw each feature."""
        return np.asarray(self.seen.sum(axis=1))

    def add_column(self, keys: Stamps, cameras: Stamps, uv: Floats, bearings: Floats) -> None:
        """A new clone saw the features `keys` (N,) of cameras (N,) at `uv` (N, 2), along `bearings` (N, 3)."""
        fresh = ~np.isin(keys, self.keys)
        all_keys = np.concatenate([self.keys, keys[fresh]])
        order = np.argsort(all_keys, kind="stable")
        n_old, n, k = len(self.keys), len(all_keys), self.seen.shape[1]
        seen_at, seen = np.zeros((n, k + 1, 5)), np.zeros((n, k + 1), dtype=bool)
        old = np.flatnonzero(order < n_old)
        seen_at[old, :k], seen[old, :k] = self._seen_at[order[old]], self.seen[order[old]]
        self.keys = all_keys[order]
        self.cameras = np.concatenate([self.cameras, cameras[fresh]])[order]
        rows = np.searchsorted(self.keys, keys)
        seen_at[rows, k, :2], seen_at[rows, k, 2:] = uv, bearings
        seen[rows, k] = True
        self._seen_at, self.seen, self.alive = seen_at, seen, seen[:, k].copy()

    def drop_column(self, k: int) -> None:
        """Clone `k` is gone; features that nothing else saw go with it."""
        self._seen_at = np.delete(self._seen_at, k, axis=1)
        self.seen = np.delete(self.seen, k, axis=1)
        self.drop_rows(~self.seen.any(axis=1) & ~self.alive)

    def drop_rows(self, mask: Mask) -> None:
        """Forget these features (F,)."""
        keep = ~mask
        self.keys, self.cameras, self.alive = self.keys[keep], self.cameras[keep], self.alive[keep]
        self._seen_at, self.seen = self._seen_at[keep], self.seen[keep]

    def consume(self, mask: Mask) -> None:
        """The observations of these features are spent; a feature that is still followed collects new ones."""
        self.seen[mask] = False
        self.drop_rows(mask & ~self.alive)

    def mark_lost(self) -> None:
        """The newest frame saw nothing."""
        self.alive[:] = False

    def clear(self) -> None:
        """Forget everything."""
        self.__init__()  # type: ignore[misc]

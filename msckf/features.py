"""Observations of features over the window of clones, as dense arrays."""

import numpy as np

from navcore.arrays import Floats, Mask, Stamps


class FeatureTable:
    """Which feature was seen where from which clone; columns follow the filter's clones.

    Attributes:
        keys: (F,) feature number, unique over cameras; sorted.
        cameras: (F,) camera index.
        uv: (F, K, 2) px.
        seen: (F, K).
        alive: (F,) whether the newest frame saw it.
    """

    def __init__(self) -> None:
        self.keys: Stamps = np.zeros(0, dtype=np.int64)
        self.cameras: Stamps = np.zeros(0, dtype=np.int64)
        self.uv: Floats = np.zeros((0, 0, 2))
        self.seen: Mask = np.zeros((0, 0), dtype=bool)
        self.alive: Mask = np.zeros(0, dtype=bool)

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def views(self) -> Stamps:
        """(F,) how many clones saw each feature."""
        return np.asarray(self.seen.sum(axis=1))

    def add_column(self, keys: Stamps, cameras: Stamps, uv: Floats) -> None:
        """A new clone saw the features `keys` (N,) of cameras (N,) at `uv` (N, 2)."""
        fresh = ~np.isin(keys, self.keys)
        all_keys = np.concatenate([self.keys, keys[fresh]])
        order = np.argsort(all_keys, kind="stable")
        n_old, n, k = len(self.keys), len(all_keys), self.uv.shape[1]
        old_uv = np.concatenate([self.uv, np.zeros((n - n_old, k, 2))])[order]
        old_seen = np.concatenate([self.seen, np.zeros((n - n_old, k), dtype=bool)])[order]
        self.keys = all_keys[order]
        self.cameras = np.concatenate([self.cameras, cameras[fresh]])[order]
        rows = np.searchsorted(self.keys, keys)
        column_uv, column_seen = np.zeros((n, 1, 2)), np.zeros((n, 1), dtype=bool)
        column_uv[rows, 0] = uv
        column_seen[rows, 0] = True
        self.uv = np.concatenate([old_uv, column_uv], axis=1)
        self.seen = np.concatenate([old_seen, column_seen], axis=1)
        self.alive = column_seen[:, 0].copy()

    def drop_column(self, k: int) -> None:
        """Clone `k` is gone; features that nothing else saw go with it."""
        self.uv = np.delete(self.uv, k, axis=1)
        self.seen = np.delete(self.seen, k, axis=1)
        self.drop_rows(~self.seen.any(axis=1) & ~self.alive)

    def drop_rows(self, mask: Mask) -> None:
        """Forget these features (F,)."""
        keep = ~mask
        self.keys, self.cameras, self.alive = self.keys[keep], self.cameras[keep], self.alive[keep]
        self.uv, self.seen = self.uv[keep], self.seen[keep]

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

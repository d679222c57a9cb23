"""Observations of features over the window of clones, as dense arrays."""

import numpy as np

from msckf.views import Rig, Views
from navcore.arrays import Floats, Mask, Stamps
from navcore.frontend import Observations


class FeatureTable:
    """Which feature was seen where: a column for each camera of each clone, those of one clone side by side.

    Attributes:
        keys: (F,) feature number, unique over cameras unless they see the same feature; sorted.
        seen: (F, K C).
        alive: (F,) whether it is followed: the newest frame saw it, or might have but for cameras that were blind.
    """

    def __init__(self, cameras: int) -> None:
        self._cameras = cameras
        self.keys: Stamps = np.zeros(0, dtype=np.int64)
        self._seen_at: Floats = np.zeros((0, 0, 5))
        self.seen: Mask = np.zeros((0, 0), dtype=bool)
        self.alive: Mask = np.zeros(0, dtype=bool)

    def __len__(self) -> int:
        return len(self.keys)

    @property
    def clones(self) -> int:
        """K."""
        return int(self.seen.shape[1]) // self._cameras

    @property
    def uv(self) -> Floats:
        """(F, K C, 2) px."""
        return self._seen_at[..., :2]

    @property
    def bearings(self) -> Floats:
        """(F, K C, 3) unit vectors in C, where nothing was seen, too."""
        return self._seen_at[..., 2:]

    @property
    def views(self) -> Stamps:
        """(F,) how many views there are of each feature."""
        return np.asarray(self.seen.sum(axis=1))

    @property
    def seen_from(self) -> Mask:
        """(F, K) whether any camera of a clone saw the feature."""
        return np.asarray(self.seen.reshape(len(self), self.clones, self._cameras).any(axis=2))

    def columns(self, clones: Stamps) -> Stamps:
        """The columns (n C,) of some of the clones (n,)."""
        return np.asarray(clones[:, None] * self._cameras + np.arange(self._cameras)).ravel()

    def views_of(self, rig: Rig, rows: Mask | Stamps, clones: Stamps | None = None) -> Views:
        """The views of some of the features, from all or some of the clones."""
        columns = self.columns(np.arange(self.clones) if clones is None else clones)
        uv, seen = self.uv[rows][:, columns], self.seen[rows][:, columns]
        as_calibrated = rig.intrinsics is None  # the bearings of the table are
        return Views(rig, uv, seen, self.bearings[rows][:, columns] if as_calibrated else None)

    def followed(self, k: int, j: int) -> tuple[Floats, Floats]:
        """Pixels (N, 2), (N, 2) of the features that one camera saw from clone `k` and from clone `j`."""
        at_k, at_j = self.columns(np.array([k])), self.columns(np.array([j]))
        both = self.seen[:, at_k] & self.seen[:, at_j]
        return self.uv[:, at_k][both], self.uv[:, at_j][both]

    def add_clone(self, seen: Observations) -> None:
        """A new clone saw this."""
        keys = np.unique(seen.keys)
        all_keys = np.union1d(self.keys, keys)
        n, k = len(all_keys), self.seen.shape[1]
        seen_at, was_seen = np.zeros((n, k + self._cameras, 5)), np.zeros((n, k + self._cameras), dtype=bool)
        old = np.searchsorted(all_keys, self.keys)
        seen_at[..., 4] = 1.0  # straight ahead, where nothing was seen
        hidden = np.zeros(n, dtype=bool)
        hidden[old] = self.alive & self._seen_by(seen.blind)
        seen_at[old, :k], was_seen[old, :k] = self._seen_at, self.seen
        rows, columns = np.searchsorted(all_keys, seen.keys), k + seen.cameras
        seen_at[rows, columns, :2], seen_at[rows, columns, 2:] = seen.uv, seen.bearings
        was_seen[rows, columns] = True
        self.keys, self._seen_at, self.seen = all_keys, seen_at, was_seen
        self.alive = np.asarray(was_seen[:, k:].any(axis=1)) | hidden

    def _seen_by(self, cameras: tuple[int, ...]) -> Mask:
        """(F,) which features any of these cameras has seen."""
        by_camera = self.seen.reshape(len(self), self.clones, self._cameras)
        return np.asarray(by_camera[:, :, list(cameras)].any(axis=(1, 2)))

    def drop_clone(self, k: int) -> None:
        """Clone `k` is gone; features that nothing else saw go with it."""
        others = self.columns(np.delete(np.arange(self.clones), k))
        self._seen_at, self.seen = self._seen_at[:, others], self.seen[:, others]
        self.drop_rows(~self.seen.any(axis=1) & ~self.alive)

    def drop_rows(self, mask: Mask) -> None:
        """Forget these features (F,)."""
        keep = ~mask
        self.keys, self.alive = self.keys[keep], self.alive[keep]
        self._seen_at, self.seen = self._seen_at[keep], self.seen[keep]

    def consume(self, mask: Mask) -> None:
        """The observations of these features are spent; a feature that is still followed collects new ones."""
        self.seen[mask] = False
        self.drop_rows(mask & ~self.alive)

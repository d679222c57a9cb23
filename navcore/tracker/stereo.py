"""Features of one camera found in another camera's image of the same time."""

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Mask, Pixels, Stamps, Vectors, among
from navcore.calibration import CameraMount
from navcore.tracker.corners import apart
from navcore.tracker.flow import flow
from navcore.tracker.tracker import Tracker

_NEIGHBOURS = 3  # matched features whose distance a new one begins at
_RETURN_PX = 1.0  # there and back again
_PAYS = 0.1  # share found of those looked for


class StereoMatcher:
    """Keeps the features of a second camera matched with those of the first.

    Both cameras follow their features in time. When the first has new ones, all that the second does not hold are
    looked for there, and again while that finds many; at every frame, a feature that both hold has to obey the
    calibrated epipolar geometry.

    Args:
        first, second: the cameras.
        tracker, other: their trackers, which share their numbers.
    """

    def __init__(self, first: CameraMount, tracker: Tracker, second: CameraMount, other: Tracker) -> None:
        self._tracker, self._other = tracker, other
        self._R_C1C0 = second.R_BC.T @ first.R_BC
        self._p_C1C0 = second.R_BC.T @ (first.p_BC - second.p_BC)
        self._tried = -1  # the newest feature that was looked for

    def match(self) -> None:
        """Match the newest images of both cameras, which were taken at the same time."""
        one, other = self._tracker, self._other
        rotated = one.bearings @ self._R_C1C0.T
        _, rows, columns = np.intersect1d(one.ids, other.ids, assume_unique=True, return_indices=True)
        fits, inverse_range = self._judge(rotated[rows], other.bearings[columns])
        there = np.ones(len(other.ids), dtype=bool)
        there[columns[~fits]] = False
        other.keep(there)
        new = self._to_try(one.ids, rows, rotated)
        found = self._look_for(new, rotated, rows[fits], inverse_range[fits])
        if found > _PAYS * len(new):  # they tell how far away the others may be
            self._tried = -1

    def _look_for(self, new: Stamps, rotated: Vectors, matched: Stamps, inverse_range: Floats) -> int:
        """Find features `new` (N,) of the first camera, knowing how far away the `matched` (M,) are; says how many."""
        one, other, config = self._tracker, self._other, self._other.config
        assert one.newest is not None
        assert other.newest is not None
        if len(new) == 0:
            return 0
        start = self._start(one.uv[new], rotated[new], one.uv[matched], inverse_range)
        inside = other.camera.inside(start)
        new, start = new[inside], start[inside]
        changed = abs(one.newest.mean - other.newest.mean) > config.brightness_change
        uv, found = flow(one.newest, other.newest, one.uv[new], start, config, changed=changed)
        new, uv = new[found], uv[found]
        bearings = other.camera.unproject(uv)
        fits, _ = self._judge(rotated[new], bearings)
        new, uv, bearings = new[fits], uv[fits], bearings[fits]
        back, returned = flow(other.newest, one.newest, uv, one.uv[new], config, changed=changed)
        returned &= np.linalg.norm(back - one.uv[new], axis=1) < _RETURN_PX
        self._add(one.ids[new[returned]], uv[returned], bearings[returned])
        return int(returned.sum())

    def _add(self, ids: Stamps, uv: Pixels, bearings: Vectors) -> None:
        """Take new matches; what the second camera followed for itself gives way to them."""
        other = self._other
        distance = 0.5 * other.config.min_distance
        shared = among(other.ids, self._tracker.ids)
        free = apart(uv, other.uv[shared], distance)
        other.keep(shared | apart(other.uv, uv[free], distance))
        other.add(ids[free], uv[free], bearings[free])

    def _judge(self, rotated: Vectors, bearings: Vectors) -> tuple[Mask, Floats]:
        """Which pairs of bearings (N, 3), both in the second camera's frame, can be one point, and its 1/range [1/m].

        A point at range r along `rotated` from the first camera lies at `rotated + p / r`, up to scale.
        """
        p = self._p_C1C0
        across = so3.cross(bearings, np.broadcast_to(p, bearings.shape))
        normal = so3.cross(rotated, bearings)
        inverse_range = (normal * across).sum(axis=1) / np.maximum((across * across).sum(axis=1), 1e-12)
        expected = rotated + inverse_range[:, None] * p
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        threshold = self._other.config.stereo_threshold / self._other.camera.focal
        off = np.linalg.norm(expected - bearings, axis=1)
        not_behind = inverse_range * np.linalg.norm(across, axis=1) > -threshold
        return np.asarray((off < threshold) & not_behind), np.maximum(inverse_range, 0.0)

    def _start(self, uv: Pixels, rotated: Vectors, uv_matched: Pixels, inverse_range: Floats) -> Pixels:
        """(N, 2) px, where features of the first camera are in the second if they are as far as those around them.

        Args:
            uv: (N, 2) px in the first camera.
            rotated: (N, 3) their bearings.
            uv_matched: (M, 2) px in the first camera of those that are matched.
            inverse_range: (M,) 1/m, how far those are.
        """
        if len(uv_matched) < _NEIGHBOURS:
            return self._other.camera.project(rotated)
        squared = ((uv[:, None] - uv_matched) ** 2).sum(axis=2)
        nearest = np.argpartition(squared, _NEIGHBOURS - 1, axis=1)[:, :_NEIGHBOURS]
        guess = np.median(inverse_range[nearest], axis=1)
        return self._other.camera.project(rotated + guess[:, None] * self._p_C1C0)

    def _to_try(self, ids: Stamps, rows: Stamps, rotated: Vectors) -> Stamps:
        """Rows of all `ids` that are not matched (which `rows` are), if new ones are among them."""
        missing = rotated[:, 2] > 0.0
        missing[rows] = False
        newest = int(ids[missing].max(initial=-1))
        if newest <= self._tried:
            return np.zeros(0, dtype=np.int64)
        self._tried = newest
        return np.flatnonzero(missing)

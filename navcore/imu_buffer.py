"""IMU samples waiting to be integrated, and their cut into cells of constant rate and specific force."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Stamps, Vectors
from navcore.errors import InputError
from navcore.imu import ImuSamples

GAP_GYRO_DENSITY = 0.1
"""rad/s/sqrt(Hz), of the rate where no sample covers the time."""
GAP_ACCEL_DENSITY = 0.5
"""m/s^2/sqrt(Hz), likewise of the specific force."""
_GAP = 1.5  # sampling intervals from one stamp to the next that count as a gap


@dataclass(frozen=True)
class Cells:
    """Consecutive intervals of constant measured rate and specific force.

    Attributes:
        dt: (N,) s.
        gyro: (N, 3) rad/s in B, biased as measured.
        accel: (N, 3) m/s^2 in B, biased as measured.
        bridged: (N,) seconds of each cell that no sample covers: non-zero only in a gap.
    """

    dt: Floats
    gyro: Vectors
    accel: Vectors
    bridged: Floats


class ImuBuffer:
    """Samples in time order, cut on demand.

    A sample is the mean over the interval around its stamp, so the cells meet half-way between stamps. Where a cell
    is cut by a frame, its two parts get the means of a line through it whose slope is that from the sample
    before: both parts together keep the cell's mean, and turn as the whole cell does.
    """

    def __init__(self, rate_hz: float) -> None:
        self.nominal_ns = round(1e9 / rate_hz)
        self._t_ns = np.zeros(0, dtype=np.int64)
        self._values = np.zeros((0, 6))

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the last sample, or None."""
        return int(self._t_ns[-1]) if len(self._t_ns) else None

    @property
    def oldest_ns(self) -> int | None:
        """Stamp of the first sample that is still held, or None."""
        return int(self._t_ns[0]) if len(self._t_ns) else None

    def append(self, samples: ImuSamples) -> None:
        """Add samples that follow the ones held.

        Raises:
            InputError: they do not; nothing is added.
        """
        if len(samples) == 0:
            return
        if len(self._t_ns) and samples.t_ns[0] <= self._t_ns[-1]:
            raise InputError(f"IMU sample at {samples.t_ns[0]} ns does not follow the last, at {self._t_ns[-1]} ns")
        self._t_ns = np.concatenate([self._t_ns, samples.t_ns])
        self._values = np.concatenate([self._values, np.hstack([samples.gyro, samples.accel])])

    def drop_before(self, t_ns: int) -> None:
        """Forget samples that no interval from `t_ns` on needs."""
        keep = max(int(np.searchsorted(self._t_ns, t_ns, side="right")) - 2, 0)
        self._t_ns, self._values = self._t_ns[keep:], self._values[keep:]

    def samples(self, start_ns: int, end_ns: int) -> tuple[Stamps, Vectors, Vectors]:
        """Stamps (N,), gyro and accelerometer samples (N, 3) within [start_ns, end_ns]."""
        first = np.searchsorted(self._t_ns, start_ns)
        last = np.searchsorted(self._t_ns, end_ns, side="right")
        return self._t_ns[first:last], self._values[first:last, :3], self._values[first:last, 3:]

    def cells(self, start_ns: int, end_ns: int) -> Cells:
        """The cells of [start_ns, end_ns]; beyond the samples held, the nearest one goes on."""
        t = self._t_ns
        if len(t) == 0 or end_ns <= start_ns:
            return Cells(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        first = max(int(np.searchsorted(t, start_ns)) - 1, 0)
        last = min(int(np.searchsorted(t, end_ns)) + 1, len(t))
        edges = 0.5 * (t[first : last - 1] - start_ns) + 0.5 * (t[first + 1 : last] - start_ns)  # ns from start
        span = float(end_ns - start_ns)
        low = np.concatenate([[min(float(t[first] - start_ns) - 0.5 * self.nominal_ns, 0.0)], edges])
        high = np.concatenate([edges, [max(float(t[last - 1] - start_ns) + 0.5 * self.nominal_ns, span)]])
        cut_low, cut_high = np.maximum(low, 0.0), np.minimum(high, span)
        inside = cut_high > cut_low
        index = first + np.flatnonzero(inside)
        low, high, cut_low, cut_high = low[inside], high[inside], cut_low[inside], cut_high[inside]

        before = np.maximum(index - 1, 0)
        step = np.maximum(t[index] - t[before], 1)[:, None]
        regular = ((high - low) < _GAP * self.nominal_ns) & (step[:, 0] < _GAP * self.nominal_ns)
        slope = np.where(regular[:, None], (self._values[index] - self._values[before]) / step, 0.0)
        off_centre = 0.5 * (cut_low + cut_high) - 0.5 * (low + high)
        values = self._values[index] + slope * off_centre[:, None]

        dt = (cut_high - cut_low) * 1e-9
        # Turns about different axes do not add up: without this, vibration and 1200 cuts make 4e-6 rad a minute.
        turn = self._values[index, :3] * (high - low)[:, None] * 1e-9
        coning = 0.5 * so3.cross(turn - values[:, :3] * dt[:, None], turn) / dt[:, None]
        values[:, :3] -= np.where((cut_low > low)[:, None], coning, 0.0)

        covered_low = np.maximum(cut_low, t[index] - start_ns - 0.5 * _GAP * self.nominal_ns)
        covered_high = np.minimum(cut_high, t[index] - start_ns + 0.5 * _GAP * self.nominal_ns)
        bridged = dt - np.clip(covered_high - covered_low, 0.0, None) * 1e-9
        return Cells(dt, values[:, :3], values[:, 3:], np.where(bridged > 1e-9, bridged, 0.0))

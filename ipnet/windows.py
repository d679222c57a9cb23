"""Windows of IMU data: centred means on a regular grid, of whole recordings or of a stream."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ipnet.errors import ConfigError
from ipnet.preintegration import bounds
from navcore.arrays import Floats, Stamps
from navcore.imu import ImuSamples

MAX_GAP_S = 0.1
"""A window never spans a longer time without a sample."""


@dataclass(frozen=True)
class Grid:
    """How a window looks.

    Attributes:
        seconds: its length.
        rate_hz: of the means in it.
        every_s: time between the ends of two windows.
    """

    seconds: float
    rate_hz: float
    every_s: float

    def __post_init__(self) -> None:
        if not all(np.isfinite(x) and x > 0.0 for x in (self.seconds, self.rate_hz, self.every_s)):
            raise ConfigError(f"{self}: expected positive numbers")
        if self.samples < 1:
            raise ConfigError(f"{self}: a window holds no sample")

    @property
    def samples(self) -> int:
        """Means in a window."""
        return round(self.seconds * self.rate_hz)


@dataclass(frozen=True)
class ImuWindow:
    """One window.

    Attributes:
        begin_ns, end_ns: its edges.
        values: (samples, 6) means of gyro [rad/s], accel [m/s^2] over the cells of the grid.
    """

    begin_ns: int
    end_ns: int
    values: Floats

    @property
    def middle_ns(self) -> int:
        """The time that a window's statement is stamped with."""
        return (self.begin_ns + self.end_ns) // 2


def means(samples: ImuSamples, edges_ns: Stamps) -> Floats:
    """(N, 6) means of gyro and accel between N + 1 edges; a sample counts with the part of it that lies between."""
    cells = bounds(samples.t_ns)
    values = np.hstack([samples.gyro, samples.accel])
    widths = np.diff(cells)[:, None] * 1e-9
    total = np.vstack([np.zeros((1, 6)), np.cumsum(values * widths, axis=0)])
    t = (cells - cells[0]) * 1e-9
    at = (np.asarray(edges_ns) - cells[0]) * 1e-9
    integral = np.stack([np.interp(at, t, total[:, k]) for k in range(6)], axis=1)
    mean: Floats = np.diff(integral, axis=0) / np.diff(at)[:, None]
    return mean


class WindowStream:
    """Cuts windows from samples as they come; after a gap it begins anew."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._samples: ImuSamples | None = None
        self._begin_ns: int | None = None  # of the next window

    def add(self, samples: ImuSamples) -> Iterator[ImuWindow]:
        """Take samples, in time order; give the windows that are complete now."""
        for part in without_gaps(samples):
            if self._samples is not None and part.t_ns[0] - self._samples.t_ns[-1] > MAX_GAP_S * 1e9:
                self._samples = None
            if self._samples is None:
                self._samples, self._begin_ns = part, None
            else:
                self._samples = joined(self._samples, part)
            yield from self._complete()

    def _complete(self) -> Iterator[ImuWindow]:
        held = self._samples
        if held is None or len(held) < 2:
            return
        cells = bounds(held.t_ns)
        if self._begin_ns is None:
            self._begin_ns = int(cells[0])
        length_ns, every_ns = round(self.grid.seconds * 1e9), round(self.grid.every_s * 1e9)
        known_ns = int(cells[-2])  # the last sample's own end depends on the one that follows
        while self._begin_ns + length_ns <= known_ns:
            edges = self._begin_ns + np.rint(np.arange(self.grid.samples + 1) * 1e9 / self.grid.rate_hz).astype(
                np.int64
            )
            yield ImuWindow(int(edges[0]), int(edges[-1]), means(held, edges))
            self._begin_ns += every_ns
        keep = int(np.searchsorted(cells, self._begin_ns, side="right")) - 2
        if keep > 0:
            self._samples = held[keep:]


def joined(*parts: ImuSamples) -> ImuSamples:
    """Parts that follow each other, as one."""
    columns = ([getattr(part, name) for part in parts] for name in ("t_ns", "gyro", "accel"))
    return ImuSamples(*(np.concatenate(column) for column in columns))


def without_gaps(samples: ImuSamples) -> Iterator[ImuSamples]:
    """The parts between gaps, in order."""
    cuts = np.flatnonzero(np.diff(samples.t_ns) > MAX_GAP_S * 1e9) + 1
    for begin, end in zip([0, *cuts], [*cuts, len(samples)], strict=True):
        if end > begin:
            yield samples[int(begin) : int(end)]

"""What an IMU is (`ImuNoise`) and what it says (`ImuSamples`)."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Stamps, Vectors, frozen
from navcore.errors import DataError

GRAVITY = 9.81
"""Magnitude of gravity [m/s^2]; g_W = (0, 0, -GRAVITY)."""


@dataclass(frozen=True)
class ImuNoise:
    """Continuous-time noise of an IMU, in Kalibr's names and units; what vibration adds is not in Kalibr's."""

    gyroscope_noise_density: float  # rad/s/sqrt(Hz)
    gyroscope_random_walk: float  # rad/s^2/sqrt(Hz)
    accelerometer_noise_density: float  # m/s^2/sqrt(Hz)
    accelerometer_random_walk: float  # m/s^3/sqrt(Hz)
    rate_hz: float = 200.0
    vibration_share: float = 0.0  # of a vibration's amplitude, that is left in the samples as white noise

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.isfinite(value) or value < 0.0 or (name == "rate_hz" and value == 0.0):
                raise DataError(f"IMU {name} is {value}, expected a finite value, not negative")


@dataclass(frozen=True)
class ImuSamples:
    """IMU samples in time order; each is the mean over the interval centred on its stamp.

    Attributes:
        t_ns: (N,) int64 ns, strictly increasing.
        gyro: (N, 3) rad/s in B.
        accel: (N, 3) specific force, m/s^2 in B.

    Raises:
        DataError: wrong shapes, a value that is not finite, or stamps that do not increase.
    """

    t_ns: Stamps
    gyro: Vectors
    accel: Vectors

    def __post_init__(self) -> None:
        n = len(np.atleast_1d(self.t_ns))
        object.__setattr__(self, "t_ns", frozen("t_ns", self.t_ns, np.int64, (None,)))
        object.__setattr__(self, "gyro", frozen("gyro", self.gyro, np.float64, (n, 3)))
        object.__setattr__(self, "accel", frozen("accel", self.accel, np.float64, (n, 3)))
        steps = np.diff(self.t_ns)
        if np.any(steps <= 0):
            k = int(np.argmax(steps <= 0))
            kind = "repeated" if steps[k] == 0 else "out of order"
            raise DataError(f"IMU stamp {self.t_ns[k + 1]} ns is {kind} after {self.t_ns[k]} ns")
        finite = np.isfinite(self.gyro).all(axis=1) & np.isfinite(self.accel).all(axis=1)
        if not finite.all():
            k = int(np.argmin(finite))
            raise DataError(f"IMU sample at {self.t_ns[k]} ns is not finite: {self.gyro[k]}, {self.accel[k]}")

    def __len__(self) -> int:
        return len(self.t_ns)

    def __getitem__(self, key: slice) -> "ImuSamples":
        return ImuSamples(self.t_ns[key], self.gyro[key], self.accel[key])

    def between(self, start_ns: int, end_ns: int) -> "ImuSamples":
        """The samples with start_ns <= t_ns < end_ns."""
        first, last = np.searchsorted(self.t_ns, [start_ns, end_ns])
        return self[first:last]

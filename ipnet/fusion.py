"""Joins the measurements of one run into an estimate of the biases over time, in a linear Kalman filter.

Model: z = b + c + e. The bias b is a random walk; c, what is wrong with the source on this run, is constant; e is
short-lived: white at one measurement a window, since windows that overlap share it.
"""

import numpy as np
from filterpy.kalman import KalmanFilter

from navcore.arrays import Floats
from navcore.imu import ImuNoise
from navcore.prior import BiasPrior

H = np.hstack([np.eye(6), np.eye(6)])  # (6, 12): z = b + c
SPREAD = (0.05, 0.3)
"""Sd of a bias of which nothing is known [rad/s, m/s^2]: what uncalibrated consumer IMUs have."""


def nothing_known(t_ns: int, spread: tuple[float, float] = SPREAD) -> BiasPrior:
    """A wide prior around zero; `spread`: sd in rad/s and m/s^2."""
    return BiasPrior(t_ns, np.zeros(3), np.zeros(3), np.diag(np.repeat(spread, 3) ** 2))


class Fusion:
    """The filter of one run.

    Args:
        start: what is known before the first measurement, at the time it speaks of.
        constant_covariance: (6, 6) of c.
        window_s: measurements closer than this share their error; of those only the first counts.
        noise: its random walks move the bias.
    """

    def __init__(self, start: BiasPrior, constant_covariance: Floats, window_s: float, noise: ImuNoise) -> None:
        self._filter = KalmanFilter(dim_x=12, dim_z=6)
        self._filter.x = np.concatenate([start.vector, np.zeros(6)])
        self._filter.P = np.zeros((12, 12))
        self._filter.P[:6, :6], self._filter.P[6:, 6:] = start.covariance, constant_covariance
        self._filter.H = H
        walk = np.repeat([noise.gyroscope_random_walk, noise.accelerometer_random_walk], 3)
        self._walk = np.diag(np.concatenate([walk**2, np.zeros(6)]))  # (12, 12) per second
        self._window_s = window_s
        self._used_ns: int | None = None  # time of the last measurement that counted
        self._now_ns = start.t_ns

    def add(self, measurement: BiasPrior) -> bool:
        """Take a measurement, in time order; False if it shares its window with the last one that counted."""
        if self._used_ns is not None and measurement.t_ns - self._used_ns < self._window_s * 1e9 - 1e6:
            return False
        self._used_ns = measurement.t_ns
        self._filter.predict(F=np.eye(12), Q=self._walk * self._seconds_to(measurement.t_ns))
        self._now_ns = max(self._now_ns, measurement.t_ns)
        self._filter.update(measurement.vector, R=measurement.covariance)
        return True

    def at(self, t_ns: int) -> BiasPrior:
        """The estimate, carried on to a time at or after the last measurement."""
        P = self._filter.P[:6, :6] + self._walk[:6, :6] * self._seconds_to(t_ns)
        return BiasPrior(t_ns, self._filter.x[:3], self._filter.x[3:6], 0.5 * (P + P.T))

    def _seconds_to(self, t_ns: int) -> float:
        return max(t_ns - self._now_ns, 0) * 1e-9

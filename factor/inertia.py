"""Samples since the last keyframe, preintegrated by GTSAM."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X

from navcore import so3
from navcore.arrays import Vectors
from navcore.imu import GRAVITY, ImuNoise
from navcore.imu_buffer import GAP_ACCEL_DENSITY, GAP_GYRO_DENSITY, Cells

_INTEGRATION = 1e-8  # m^2/s, of positions: keeps the covariance of a short stretch regular


class Inertia:
    """What the IMU says since a keyframe (Forster et al. 2017; GTSAM's combined factor).

    Args:
        noise: of the IMU; what its biases walk is the same all the time.
    """

    def __init__(self, noise: ImuNoise) -> None:
        self._params = gtsam.PreintegrationCombinedParams.MakeSharedU(GRAVITY)
        self._params.setIntegrationCovariance(_INTEGRATION * np.eye(3))
        self._params.setBiasAccCovariance(noise.accelerometer_random_walk**2 * np.eye(3))
        self._params.setBiasOmegaCovariance(noise.gyroscope_random_walk**2 * np.eye(3))
        self.begin(gtsam.imuBias.ConstantBias())

    def begin(self, bias: gtsam.imuBias.ConstantBias) -> None:
        """At a keyframe; samples are integrated at this bias."""
        self._measured = gtsam.PreintegratedCombinedMeasurements(self._params, bias)

    @property
    def seconds(self) -> float:
        """Since the keyframe."""
        return float(self._measured.deltaTij())

    def extend(
        self, cells: Cells, noise: ImuNoise, state: gtsam.NavState, bias: gtsam.imuBias.ConstantBias
    ) -> gtsam.NavState:
        """Integrate cells under this noise; returns where they lead from a state, at this bias."""
        step = gtsam.PreintegratedCombinedMeasurements(self._params, bias)
        forces = _turned_half(cells, bias)
        for dt, gyro, accel, bridged in zip(cells.dt, cells.gyro, forces, cells.bridged, strict=True):
            uncovered = bridged / dt
            gyro_density = noise.gyroscope_noise_density**2 + uncovered * GAP_GYRO_DENSITY**2
            accel_density = noise.accelerometer_noise_density**2 + uncovered * GAP_ACCEL_DENSITY**2
            self._params.setGyroscopeCovariance(gyro_density * np.eye(3))
            self._params.setAccelerometerCovariance(accel_density * np.eye(3))
            self._measured.integrateMeasurement(accel, gyro, dt)
            step.integrateMeasurement(accel, gyro, dt)
        return step.predict(state, bias)

    def factor(self, k: int, n: int) -> gtsam.CombinedImuFactor:
        """Between keyframe `k` and frame `n`, which is now."""
        return gtsam.CombinedImuFactor(X(k), V(k), X(n), V(n), B(k), B(n), self._measured)


def _turned_half(cells: Cells, bias: gtsam.imuBias.ConstantBias) -> Vectors:
    """(N, 3) forces as they are felt by the body as it was when each cell began.

    A sample is the mean over its cell, in which the body turns. GTSAM takes the attitude at the cell's beginning, which
    at 1 rad/s and 200 Hz is wrong by 0.025 m/s^2, as much as a bias.
    """
    half = so3.exp(0.5 * (cells.gyro - bias.gyroscope()) * cells.dt[:, None])
    unbiased = cells.accel - bias.accelerometer()
    return np.asarray((half @ unbiased[..., None])[..., 0] + bias.accelerometer())

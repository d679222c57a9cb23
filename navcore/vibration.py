"""What vibration adds to the noise of an IMU (docs/filter.md, section 2)."""

from dataclasses import replace

import numpy as np

from navcore.arrays import Stamps, Vectors
from navcore.imu import ImuNoise

WINDOW_S = 0.4
"""Stretch of samples in which vibration is measured [s]."""

_OF_WHITE_NOISE = 70.0  # mean square of its fourth differences (1, -4, 6, -4, 1); a body's motion leaves less in them


def noise_under_vibration(noise: ImuNoise, t_ns: Stamps, gyro: Vectors, accel: Vectors) -> ImuNoise:
    """The noise of an IMU that vibrates as these samples do.

    Samples that vibrate are folded into the band of the motion and rectified by scale and misalignment. How much of a
    vibration's amplitude is left there as white noise is a property of IMU and mounting; its amplitude is what
    their fourth differences show above the white noise of an IMU at rest.

    Args:
        noise: at rest.
        t_ns: (N,) ns, gyro, accel: (N, 3) rad/s and m/s^2, consecutive samples; fewer than five show nothing.
    """
    if noise.vibration_share == 0.0 or len(t_ns) < 5:
        return noise
    even = np.abs((t_ns[4:] - t_ns[:-4]) * 1e-9 * noise.rate_hz - 4.0) < 0.5
    if not even.any():
        return noise

    def density(x: Vectors, at_rest: float) -> float:
        fourth = (x[4:] - 4.0 * (x[3:-1] + x[1:-3]) + 6.0 * x[2:-2] + x[:-4])[even]
        power = np.vdot(fourth, fourth) / (fourth.size * _OF_WHITE_NOISE * noise.rate_hz)
        return float(np.sqrt(at_rest**2 + noise.vibration_share**2 * max(power - at_rest**2, 0.0)))

    return replace(
        noise,
        gyroscope_noise_density=density(gyro, noise.gyroscope_noise_density),
        accelerometer_noise_density=density(accel, noise.accelerometer_noise_density),
    )

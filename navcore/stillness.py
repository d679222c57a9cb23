"""Standing still, as IMU and images show it together."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Pixels
from navcore.imu_buffer import ImuBuffer


@dataclass(frozen=True)
class StillnessConfig:
    """When a body stands still."""

    enabled: bool = True
    window_s: float = 0.4  # s of IMU that have to be quiet
    gyro_std: float = 0.02  # rad/s, standard deviation below which the rate is steady
    accel_std: float = 0.15  # m/s^2, likewise
    max_disparity: float = 0.4  # px, motion of the image since standstill began


def imu_is_quiet(buffer: ImuBuffer, t_ns: int, config: StillnessConfig) -> bool:
    """Whether rate and specific force were steady for a window up to IMU time `t_ns`."""
    _, gyro, accel = buffer.samples(t_ns - round(config.window_s * 1e9), t_ns)
    if len(gyro) < 10:
        return False
    return bool(gyro.std(axis=0).max() < config.gyro_std and accel.std(axis=0).max() < config.accel_std)


def image_motion(before: Pixels, now: Pixels) -> float | None:
    """How far the image moved [px, rms], from features (N, 2) in two pictures; None if they are too few to tell.

    The motion is the affine field that fits the features, so that their noise averages out; features that do not
    fit (on things that move) are left out of it. What remains of the noise is known from the misfit, and taken off:
    of n features with squared misfit s^2 each, 3 s^2 / (n - 3) in the square of the field.
    """
    n = len(before)
    if n < 12:
        return None
    basis = np.column_stack([np.ones(n), (before - before.mean(axis=0)) / 100.0])
    flow = now - before
    inlier = np.linalg.norm(flow - np.median(flow, axis=0), axis=1)
    keep = inlier <= 3.0 * np.median(inlier) + 1e-9
    for _ in range(2):
        field = basis @ np.linalg.lstsq(basis[keep], flow[keep], rcond=None)[0]
        misfit = np.linalg.norm(flow - field, axis=1)
        keep = misfit <= 3.0 * np.median(misfit) + 1e-9
    square, noise = (float(np.mean(np.sum(x[keep] ** 2, axis=1))) for x in (field, flow - field))
    return float(np.sqrt(max(square - 3.0 * noise / (keep.sum() - 3.0), 0.0)))

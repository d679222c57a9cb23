"""A body that swings and turns, known in closed form: recordings with biases that are known."""

import numpy as np

from navcore import so3
from navcore.calibration import Calibration
from navcore.imu import GRAVITY, ImuNoise, ImuSamples
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory

BIAS = np.array([0.02, -0.03, 0.05, 0.1, -0.2, 0.15])
NOISE = ImuNoise(1e-3, 1e-6, 1e-2, 1e-5, 200.0)
_DT = 0.005


def pose(t):
    """R_WB (N, 3, 3), p_WB, v_WB (N, 3)."""
    rates, sizes = np.array([0.7, 0.9, 1.3]), np.array([1.5, 1.0, 0.4])
    s = t[:, None]
    R = so3.exp(np.stack([0 * t, 0 * t, 1.2 * np.sin(0.35 * t) + 0.2 * t], axis=1)) @ so3.exp(
        np.stack([0.4 * np.sin(0.8 * t), 0.3 * np.sin(1.1 * t + 1.0), 0 * t], axis=1)
    )
    return R, sizes * np.sin(rates * s), sizes * rates * np.cos(rates * s)


def samples(seconds, bias=BIAS, noise=None, rng=None):
    """What the IMU says: means over each 5 ms, with biases and white noise."""
    edges = np.arange(round(seconds / _DT) + 1) * _DT
    R, _, v = pose(edges)
    gyro = so3.log(np.swapaxes(R[:-1], 1, 2) @ R[1:]) / _DT + bias[:3]
    middle = R[:-1] @ so3.exp(0.5 * _DT * (gyro - bias[:3]))
    force = np.diff(v, axis=0) / _DT + [0.0, 0.0, GRAVITY]
    accel = np.einsum("nji,nj->ni", middle, force) + bias[3:]
    if noise is not None:
        gyro = gyro + noise.gyroscope_noise_density / np.sqrt(_DT) * rng.standard_normal(gyro.shape)
        accel = accel + noise.accelerometer_noise_density / np.sqrt(_DT) * rng.standard_normal(accel.shape)
    return ImuSamples(np.rint((edges[:-1] + 0.5 * _DT) * 1e9).astype(np.int64), gyro, accel)


def truth(seconds, rate_hz=50.0, rng=None, angle=0.0, distance=0.0):
    """Poses, with errors of a standard deviation: angle [rad], distance [m]."""
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    R, p, _ = pose(t)
    if rng is not None:
        R = R @ so3.exp(angle * rng.standard_normal(p.shape))
        p = p + distance * rng.standard_normal(p.shape)
    return Trajectory(np.rint(t * 1e9).astype(np.int64), so3.to_quaternion(R), p)


def recording(seconds=40.0, imu=None, path=None, noise=NOISE, name="swinging"):
    """Both, as a sequence without cameras."""
    return Sequence(name, Calibration(noise), imu or samples(seconds), (), path or truth(seconds))

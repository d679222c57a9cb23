"""Start while standing still: gravity and gyro bias from a quiet stretch (docs/filter.md, section 6)."""

import numpy as np
from scipy.spatial.transform import Rotation

from msckf.blocks import ACCEL_BIAS, GYRO_BIAS, THETA, VELOCITY
from msckf.config import StandstillConfig
from msckf.propagation import G_W
from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors
from navcore.imu import GRAVITY, ImuNoise
from navcore.odometry import State
from navcore.prior import BiasPrior

_VELOCITY_SIGMA = 0.01  # m/s, how still standing still is
_MEAN_S = 0.1  # s, over which vibration averages out
_RATE_SIGMA = 1e-3  # rad/s, likewise
_FORCE_SIGMA = 0.01  # m/s^2, likewise
_GRAVITY_SIGMA = 0.02  # m/s^2, of gravity over the Earth


def gravity_aligned(specific_force: Vectors) -> Rotations:
    """R_WB (3, 3) with zero yaw turn that takes a resting specific force (3,) in B to straight up in W."""
    up = specific_force / np.linalg.norm(specific_force)
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine, cosine = np.linalg.norm(axis), up[2]
    if sine < 1e-9:
        return np.eye(3) if cosine > 0.0 else np.asarray(Rotation.from_euler("x", np.pi).as_matrix())
    return so3.exp(axis / sine * np.arctan2(sine, cosine))


def is_steady(gyro: Vectors, accel: Vectors, rate_hz: float, config: StandstillConfig) -> bool:
    """Whether samples (N, 3) are steady but for vibration, as on the ground with the motors on: in means of 0.1 s."""
    n = max(round(_MEAN_S * rate_hz), 1)
    if len(gyro) < 4 * n:
        return False
    k = len(gyro) // n
    turned, pushed = (x[: k * n].reshape(k, n, 3).mean(axis=1).std(axis=0).max() for x in (gyro, accel))
    return bool(turned < config.gyro_std and pushed < config.accel_std)


def static_start(gyro: Vectors, accel: Vectors, noise: ImuNoise, device: BiasPrior) -> State:
    """The state at the end of a quiet stretch.

    Along gravity the force measures the accelerometer's bias. Across it tilt and bias cannot be told apart,
    a_m = -R^T g + b_a + n; their errors are correlated as this equation says: dtheta = [u]x (db_a + n) / |u|^2 with
    u = -R^T g.

    Args:
        gyro, accel: (N, 3) samples of the stretch.
        noise: of the IMU.
        device: what is known of the biases beforehand.

    Returns:
        State with position 0 and yaw 0, both without uncertainty: they are the gauge.
    """
    span = len(gyro) / noise.rate_hz
    force_noise = np.eye(3) * (noise.accelerometer_noise_density**2 / span + _FORCE_SIGMA**2)
    b_a, P_a = _along_gravity(accel.mean(axis=0), force_noise[0, 0], device)
    R_WB = gravity_aligned(accel.mean(axis=0) - b_a)
    u = -R_WB.T @ G_W

    prior_g = device.covariance[:3, :3]
    mean_g = np.eye(3) * (noise.gyroscope_noise_density**2 / span + _RATE_SIGMA**2)
    gain = prior_g @ np.linalg.inv(prior_g + mean_g)
    b_g = device.b_g + gain @ (gyro.mean(axis=0) - device.b_g)

    P = np.zeros((15, 15))
    M = so3.hat(u) / (u @ u)
    P[THETA, THETA] = M @ (P_a + force_noise) @ M.T
    P[THETA, ACCEL_BIAS] = M @ P_a
    P[ACCEL_BIAS, THETA] = P[THETA, ACCEL_BIAS].T
    P[ACCEL_BIAS, ACCEL_BIAS] = P_a
    P[GYRO_BIAS, GYRO_BIAS] = prior_g - gain @ prior_g
    P[VELOCITY, VELOCITY] = np.eye(3) * _VELOCITY_SIGMA**2
    return State(R_WB, np.zeros(3), np.zeros(3), b_g, b_a, 0.5 * (P + P.T))


def force_surprise(accel: Vectors, device: BiasPrior) -> float:
    """By how many standard deviations the mean of specific forces (N, 3) differs in size from a rig's at rest."""
    force = accel.mean(axis=0) - device.b_a
    up = force / np.linalg.norm(force)
    return float(abs(up @ force - GRAVITY) / np.sqrt(up @ device.covariance[3:, 3:] @ up + _GRAVITY_SIGMA**2))


def _along_gravity(mean: Vectors, variance: float, device: BiasPrior) -> tuple[Vectors, Floats]:
    """Accelerometer bias (3,) and its covariance, after |mean - b_a| = 9.81 m/s^2 was measured."""
    force, P = mean - device.b_a, device.covariance[3:, 3:]
    up = force / np.linalg.norm(force)
    gain = P @ up / (up @ P @ up + variance + _GRAVITY_SIGMA**2)
    return device.b_a + gain * (up @ force - GRAVITY), P - np.outer(gain, up @ P)

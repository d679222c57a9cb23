"""Start while standing still: gravity and gyro bias from a quiet stretch (docs/filter.md, section 6)."""

import numpy as np
from scipy.spatial.transform import Rotation

from msckf.blocks import ACCEL_BIAS, GYRO_BIAS, POSITION, THETA, VELOCITY
from msckf.propagation import G_W
from navcore import so3
from navcore.arrays import Rotations, Vectors
from navcore.imu import ImuNoise
from navcore.odometry import State
from navcore.prior import BiasPrior

_VELOCITY_SIGMA = 0.01  # m/s, how still standing still is


def gravity_aligned(specific_force: Vectors) -> Rotations:
    """R_WB (3, 3) with zero yaw turn that takes a resting specific force (3,) in B to straight up in W."""
    up = specific_force / np.linalg.norm(specific_force)
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine, cosine = np.linalg.norm(axis), up[2]
    if sine < 1e-9:
        return np.eye(3) if cosine > 0.0 else np.asarray(Rotation.from_euler("x", np.pi).as_matrix())
    return so3.exp(axis / sine * np.arctan2(sine, cosine))


def static_start(gyro: Vectors, accel: Vectors, noise: ImuNoise, device: BiasPrior) -> State:
    """The state at the end of a quiet stretch.

    Tilt and accelerometer bias cannot be told apart at rest, a_m = -R^T g + b_a + n; their errors are correlated as
    this equation says: dtheta = [u]x (db_a + n) / |u|^2 with u = -R^T g.

    Args:
        gyro, accel: (N, 3) samples of the stretch.
        noise: of the IMU.
        device: what is known of the biases beforehand.

    Returns:
        State with position 0 and yaw 0, both without uncertainty: they are the gauge.
    """
    n = len(gyro)
    span = n / noise.rate_hz
    R_WB = gravity_aligned(accel.mean(axis=0) - device.b_a)
    u = -R_WB.T @ G_W

    prior_g = device.covariance[:3, :3]
    mean_g = np.eye(3) * (noise.gyroscope_noise_density**2 / span + 1e-10)
    gain = prior_g @ np.linalg.inv(prior_g + mean_g)
    b_g = device.b_g + gain @ (gyro.mean(axis=0) - device.b_g)

    P = np.zeros((15, 15))
    P_a = device.covariance[3:, 3:]
    M = so3.hat(u) / (u @ u)
    force_noise = np.eye(3) * (noise.accelerometer_noise_density**2 / span + 1e-6)
    P[THETA, THETA] = M @ (P_a + force_noise) @ M.T
    P[THETA, ACCEL_BIAS] = M @ P_a
    P[ACCEL_BIAS, THETA] = P[THETA, ACCEL_BIAS].T
    P[ACCEL_BIAS, ACCEL_BIAS] = P_a
    P[GYRO_BIAS, GYRO_BIAS] = prior_g - gain @ prior_g
    P[POSITION, POSITION] = np.zeros((3, 3))
    P[VELOCITY, VELOCITY] = np.eye(3) * _VELOCITY_SIGMA**2
    zero = np.zeros(3)
    return State(R_WB, zero, zero, b_g, np.array(device.b_a), 0.5 * (P + P.T))

"""IMU propagation: closed-form mean, transition and noise between two times (docs/filter.md, section 2)."""

from dataclasses import dataclass

import numpy as np

from msckf.blocks import ACCEL_BIAS, BIASES, GYRO_BIAS, MOTION, POSITION, THETA, VELOCITY
from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors
from navcore.imu import GRAVITY, ImuNoise
from navcore.imu_buffer import GAP_ACCEL_DENSITY, GAP_GYRO_DENSITY, Cells

G_W = np.array([0.0, 0.0, -GRAVITY])
"""Gravity in W [m/s^2]."""

# What is assumed about the motion that no sample covers, as white noise over the gap.


@dataclass(frozen=True)
class Increment:
    """Motion over an interval, as the body saw it: free of the state that it is applied to.

    With R, p, v at the start: R' = R delta_R, v' = v + g dt + R delta_v, p' = p + v dt + g dt^2/2 + R delta_p.

    Attributes:
        dt: s.
        delta_R: (3, 3).
        delta_v, delta_p: (3,) m/s and m in B at the start.
        J: (9, 6) derivative of (rotation, position, velocity increments) by (b_g, b_a), rotation on the right.
        Q: (15, 15) noise in the error order, position and velocity in B at the start.
    """

    dt: float
    delta_R: Rotations
    delta_v: Vectors
    delta_p: Vectors
    J: Floats
    Q: Floats


def _integrals(phi: Vectors) -> tuple[Rotations, Floats, Floats]:
    """Exp(phi), its mean and its double integral over the interval: (N, 3) to three (N, 3, 3)."""
    s = np.sum(phi * phi, axis=-1)
    small = s < 1e-4
    s_safe = np.where(small, 1.0, s)
    t = np.sqrt(s_safe)
    sin, cos = np.sin(t), np.cos(t)
    sinc = np.where(small, 1.0 - s / 6.0 + s * s / 120.0, sin / t)
    a = np.where(small, 0.5 - s / 24.0 + s * s / 720.0, (1.0 - cos) / s_safe)
    b = np.where(small, 1.0 / 6.0 - s / 120.0 + s * s / 5040.0, (t - sin) / (s_safe * t))
    c = np.where(small, 1.0 / 24.0 - s / 720.0 + s * s / 40320.0, (0.5 * s_safe + cos - 1.0) / (s_safe * s_safe))
    K = so3.hat(phi)
    KK = K @ K
    eye = np.eye(3)

    def series(x0: float, x1: Floats, x2: Floats) -> Floats:
        return x0 * eye + x1[:, None, None] * K + x2[:, None, None] * KK

    return series(1.0, sinc, a), series(1.0, a, b), series(0.5, b, c)


def _steps(dt: Floats, omega: Vectors, force: Vectors) -> tuple[Rotations, Vectors, Vectors, Floats]:
    """Rotation, velocity and position increments of each cell and the (N, 15, 15) transitions in the cell's B.

    `F` is exact to second order in the cell's rotation; its position and velocity are in B at the cell's start.
    """
    n = len(dt)
    phi = omega * dt[:, None]
    E, G1, G2 = _integrals(phi)
    d1, d2 = dt[:, None, None], (dt * dt)[:, None, None]
    dv = (G1 @ force[:, :, None])[:, :, 0] * dt[:, None]
    dp = (G2 @ force[:, :, None])[:, :, 0] * (dt * dt)[:, None]
    f_hat, phi_hat = so3.hat(force), so3.hat(phi)
    second = so3.hat(so3.cross(phi, force)) + phi_hat @ f_hat
    F = np.broadcast_to(np.eye(15), (n, 15, 15)).copy()
    F[:, THETA, THETA] = np.swapaxes(E, 1, 2)
    F[:, THETA, GYRO_BIAS] = -np.swapaxes(G1, 1, 2) * d1  # right Jacobian = transposed left Jacobian
    F[:, POSITION, THETA] = -so3.hat(dp)
    F[:, POSITION, VELOCITY] = np.eye(3) * d1
    F[:, POSITION, GYRO_BIAS] = (f_hat / 6.0 + second / 24.0) * (d2 * d1)
    F[:, POSITION, ACCEL_BIAS] = -G2 * d2
    F[:, VELOCITY, THETA] = -so3.hat(dv)
    F[:, VELOCITY, GYRO_BIAS] = (f_hat / 2.0 + second / 6.0) * d2
    F[:, VELOCITY, ACCEL_BIAS] = -G1 * d1
    return E, dv, dp, F


def integrate(cells: Cells, b_g: Vectors, b_a: Vectors, noise: ImuNoise) -> Increment:
    """Integrate cells at given biases, with derivatives by the biases and the noise covariance.

    Mean: rate and specific force are constant in B over a cell (closed form). Noise: white densities that enter at the
    middle of each cell, which agrees with van Loan's integral to (cell / interval)^2.
    """
    n = len(cells.dt)
    if n == 0:
        return Increment(0.0, np.eye(3), np.zeros(3), np.zeros(3), np.zeros((9, 6)), np.zeros((15, 15)))
    dt = cells.dt
    omega, force = cells.gyro - b_g, cells.accel - b_a
    both_dt = np.concatenate([dt, 0.5 * dt])
    E, dv, dp, F = _steps(both_dt, np.tile(omega, (2, 1)), np.tile(force, (2, 1)))

    R = np.empty((n + 1, 3, 3))  # body at the start of each cell, seen from the start of all
    R[0] = np.eye(3)
    for k in range(n):
        R[k + 1] = R[k] @ E[k]
    dv_0 = (R[:n] @ dv[:n, :, None])[:, :, 0]
    v = np.cumsum(dv_0, axis=0)
    v_before = v - dv_0
    delta_p = np.sum(v_before * dt[:, None] + (R[:n] @ dp[:n, :, None])[:, :, 0], axis=0)

    # Rotate position and velocity rows of every cell into B at the start of all.
    R_each = np.concatenate([R[:n], R[:n]])
    for rows in (POSITION, VELOCITY):
        F[:, rows, THETA] = R_each @ F[:, rows, THETA]
        F[:, rows, BIASES] = R_each @ F[:, rows, BIASES]
    to_end = np.empty((n + 1, 15, 15))  # transition from the start of cell k to the end of all
    to_end[n] = np.eye(15)
    for k in range(n - 1, -1, -1):
        to_end[k] = to_end[k + 1] @ F[k]

    from_middle = to_end[1:] @ F[n:]  # the second half's transition is the first half's, to first order
    gyro_density = noise.gyroscope_noise_density**2 * dt + GAP_GYRO_DENSITY**2 * cells.bridged
    accel_density = noise.accelerometer_noise_density**2 * dt + GAP_ACCEL_DENSITY**2 * cells.bridged
    root = np.empty((n, 15))
    root[:, THETA] = np.sqrt(gyro_density)[:, None]
    root[:, POSITION] = 0.0
    root[:, VELOCITY] = np.sqrt(accel_density)[:, None]
    root[:, GYRO_BIAS] = noise.gyroscope_random_walk * np.sqrt(dt)[:, None]
    root[:, ACCEL_BIAS] = noise.accelerometer_random_walk * np.sqrt(dt)[:, None]
    W = np.swapaxes(from_middle * root[:, None, :], 0, 1).reshape(15, -1)  # (15, n * 15)
    return Increment(float(dt.sum()), R[n], v[-1], delta_p, to_end[0][MOTION, BIASES], W @ W.T)


def transition(
    increment: Increment,
    start: tuple[Rotations, Vectors, Vectors],
    end: tuple[Rotations, Vectors, Vectors],
) -> Floats:
    """Phi (15, 15) between two states (R_WB, p_WB, v_WB) at which it is linearised.

    Built from the states at both ends alone, Phi maps the four unobservable directions of one exactly onto
    those of the other: first estimates have to be given for that (Hesch et al. 2014, "Camera-IMU-based localization:
    observability analysis and consistency improvement", eqs. 43-45; Li and Mourikis 2013, "High-precision, consistent
    EKF-based visual-inertial odometry", section 4).
    """
    (R_0, p_0, v_0), (R_1, p_1, v_1) = start, end
    dt = increment.dt
    Phi = np.eye(15)
    Phi[THETA, THETA] = R_1.T @ R_0
    Phi[THETA, BIASES] = increment.J[THETA]
    Phi[POSITION, THETA] = -so3.hat(p_1 - p_0 - v_0 * dt - 0.5 * G_W * dt * dt) @ R_0
    Phi[POSITION, VELOCITY] = np.eye(3) * dt
    Phi[POSITION, BIASES] = R_0 @ increment.J[POSITION]
    Phi[VELOCITY, THETA] = -so3.hat(v_1 - v_0 - G_W * dt) @ R_0
    Phi[VELOCITY, BIASES] = R_0 @ increment.J[VELOCITY]
    return Phi


def predict(R_WB: Rotations, p_WB: Vectors, v_WB: Vectors, increment: Increment) -> tuple[Rotations, Vectors, Vectors]:
    """Pose and velocity after an increment."""
    dt = increment.dt
    return (
        so3.normalise(R_WB @ increment.delta_R),
        p_WB + v_WB * dt + 0.5 * G_W * dt * dt + R_WB @ increment.delta_p,
        v_WB + G_W * dt + R_WB @ increment.delta_v,
    )


def noise_in_world(increment: Increment, R_WB: Rotations) -> Floats:
    """Q (15, 15) with position and velocity in W; `R_WB` is the linearisation point at the start."""
    T = np.eye(15)
    T[POSITION, POSITION] = T[VELOCITY, VELOCITY] = R_WB
    return T @ increment.Q @ T.T

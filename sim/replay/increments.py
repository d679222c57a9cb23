"""IMU samples as factors between neighbouring knots."""

import numpy as np

from navcore import so3
from navcore.arrays import Floats
from navcore.imu import ImuNoise
from sim.replay.chain import B_A, B_G, SIZE, THETA, Normal, P, V
from sim.replay.knots import Intervals, Knots, g_W, second_integral, turned


def residuals(knots: Knots, intervals: Intervals) -> Floats:
    """(N, 15) by how much neighbouring knots differ from what the sample between them says, unweighted.

    For a constant rate and specific force over the interval, which integrate in closed form:
    rotation [rad], position [m] and velocity [m/s] in B of the first knot, then the steps of the biases.
    """
    h = intervals.h[:, None]
    phi, force = (intervals.imu.gyro - knots.b_g[:-1]) * h, intervals.imu.accel - knots.b_a[:-1]
    R_BW = np.swapaxes(knots.R_WB[:-1], 1, 2)
    r = np.empty((len(h), SIZE))
    r[:, THETA] = so3.log(so3.exp(-phi) @ R_BW @ knots.R_WB[1:])
    r[:, P] = turned(R_BW, _fall(knots, h)) - turned(second_integral(phi), force) * h**2
    r[:, V] = turned(R_BW, np.diff(knots.v_WB, axis=0) - g_W * h) - turned(so3.left_jacobian(phi), force) * h
    r[:, B_G], r[:, B_A] = np.diff(knots.b_g, axis=0), np.diff(knots.b_a, axis=0)
    return r


def add(normal: Normal, knots: Knots, intervals: Intervals, noise: ImuNoise) -> None:
    """Add the factors of all samples to normal equations."""
    r = whiten(residuals(knots, intervals), intervals.h, noise)
    before, after = _jacobians(knots, intervals)
    before, after = whiten(before, intervals.h, noise), whiten(after, intervals.h, noise)
    before_t, after_t = np.swapaxes(before, 1, 2), np.swapaxes(after, 1, 2)
    normal.own[:-1] += before_t @ before
    normal.own[1:] += after_t @ after
    normal.next += after_t @ before
    normal.g[:-1] -= (before_t @ r[..., None])[..., 0]
    normal.g[1:] -= (after_t @ r[..., None])[..., 0]


def whiten(x: Floats, h: Floats, noise: ImuNoise) -> Floats:
    """Rows (N, 15, ...) of residuals scaled to unit variance.

    White acceleration noise of density s gives velocity and position over h the covariance
    s^2 [[h, h^2/2], [h^2/2, h^3/3]]; its inverse square root is in closed form.
    """
    h = h.reshape(-1, *[1] * (x.ndim - 1))
    out = np.empty_like(x)
    root = np.sqrt(h)
    out[:, THETA] = x[:, THETA] / (noise.gyroscope_noise_density * root)
    out[:, V] = x[:, V] / (noise.accelerometer_noise_density * root)
    apart = x[:, P] / (noise.accelerometer_noise_density * root * h) - 0.5 * out[:, V]
    out[:, P] = np.sqrt(12.0) * apart
    out[:, B_G] = x[:, B_G] / (noise.gyroscope_random_walk * root)
    out[:, B_A] = x[:, B_A] / (noise.accelerometer_random_walk * root)
    return out


def _jacobians(knots: Knots, intervals: Intervals) -> tuple[Floats, Floats]:
    """(N, 15, 15) by the knot before and the knot after; exact for residuals that have become small."""
    h = intervals.h[:, None]
    hh = h[..., None]
    R_BW = np.swapaxes(knots.R_WB[:-1], 1, 2)
    before, after = np.zeros((len(h), SIZE, SIZE)), np.zeros((len(h), SIZE, SIZE))
    before[:, THETA, THETA] = -np.swapaxes(knots.R_WB[1:], 1, 2) @ knots.R_WB[:-1]
    phi = (intervals.imu.gyro - knots.b_g[:-1]) * h
    before[:, THETA, B_G] = hh * so3.right_jacobian(phi)
    before[:, P, THETA] = so3.hat(turned(R_BW, _fall(knots, h)))
    before[:, P, P], before[:, P, V] = -R_BW, -R_BW * hh
    before[:, P, B_A] = hh**2 * second_integral(phi)
    before[:, V, THETA] = so3.hat(turned(R_BW, np.diff(knots.v_WB, axis=0) - g_W * h))
    before[:, V, V], before[:, V, B_A] = -R_BW, hh * so3.left_jacobian(phi)
    before[:, B_G, B_G] = before[:, B_A, B_A] = -np.eye(3)
    after[:, P, P] = after[:, V, V] = R_BW
    after[:, THETA, THETA] = after[:, B_G, B_G] = after[:, B_A, B_A] = np.eye(3)
    return before, after


def _fall(knots: Knots, h: Floats) -> Floats:
    """(N, 3) how far position goes beyond free fall, in W."""
    out: Floats = np.diff(knots.p_WB, axis=0) - knots.v_WB[:-1] * h - 0.5 * g_W * h**2
    return out

"""Preintegrated IMU measurements of many intervals at once, with their derivatives by the biases.

Forster, Carlone, Dellaert, Scaramuzza, "On-manifold preintegration for real-time visual-inertial odometry", IEEE
T-RO 2017, eqs. 33 (terms), 44 (bias Jacobians) and 62 (noise), here with rate and specific force constant in B over
each sample's interval, integrated in closed form.
"""

from dataclasses import dataclass

import numpy as np

from ipnet.errors import ConfigError
from navcore import so3
from navcore.arrays import Floats, Rotations, Stamps, Vectors
from navcore.imu import ImuNoise, ImuSamples


@dataclass(frozen=True)
class Increments:
    """Motion over N intervals as the body saw it.

    With R, p, v at an interval's start and T its length: R' = R delta_R, v' = v + g T + R delta_v,
    p' = p + v T + g T^2 / 2 + R delta_p.

    Attributes:
        dt: (N,) s.
        delta_R: (N, 3, 3).
        delta_v, delta_p: (N, 3) m/s and m, in B at the start.
        J: (N, 9, 6) derivative of (rotation, velocity, position) by (b_g, b_a), rotation on the right.
        Q: (N, 9, 9) covariance of (rotation, velocity, position) from white noise.
        mean_RT, mean_tRT: (N, 3, 3) means over the interval of delta_R(t)^T and t delta_R(t)^T.
        mean_RTv: (N, 3) m/s, mean of delta_R(t)^T delta_v(t); so velocity in B is, on average,
            mean_RT R^T v + mean_tRT R^T g + mean_RTv.
    """

    dt: Floats
    delta_R: Rotations
    delta_v: Vectors
    delta_p: Vectors
    J: Floats
    Q: Floats
    mean_RT: Floats
    mean_tRT: Floats
    mean_RTv: Vectors


def preintegrate(
    samples: ImuSamples, edges_ns: Stamps, b_g: Vectors, b_a: Vectors, noise: ImuNoise | None = None
) -> Increments:
    """Preintegrate between successive edges.

    A sample holds from half-way to the one before to half-way to the next; an edge inside cuts it.

    Args:
        samples: IMU samples; each is the mean over the interval centred on its stamp.
        edges_ns: (N + 1,) int64 ns, increasing, from `coverage`'s first to its last.
        b_g: (3,) or (N, 3) rad/s, subtracted.
        b_a: (3,) or (N, 3) m/s^2, subtracted.
        noise: densities for `Q`; without them it is zero.

    Raises:
        ConfigError: edges do not increase or leave what the samples cover.
    """
    edges_ns = np.asarray(edges_ns, dtype=np.int64)
    first_ns, last_ns = coverage(samples)
    if len(edges_ns) < 2 or np.any(np.diff(edges_ns) <= 0):
        raise ConfigError(f"expected two or more edges that increase, got {edges_ns[:3].tolist()}...")
    if edges_ns[0] < first_ns or edges_ns[-1] > last_ns:
        raise ConfigError(f"edges {edges_ns[0]}..{edges_ns[-1]} ns; samples cover {first_ns}..{last_ns} ns")
    dt, index = _pieces(samples.t_ns, edges_ns)  # (N, M): padding has dt = 0
    n, m = dt.shape
    omega = samples.gyro[index] - np.broadcast_to(b_g, (n, 3))[:, None]
    force = samples.accel[index] - np.broadcast_to(b_a, (n, 3))[:, None]
    phi = omega * dt[..., None]
    half = so3.exp(0.5 * phi)  # to the middle of a piece
    R = np.empty((n, m + 1, 3, 3))  # body at the start of each piece, seen from the interval's start
    R[:, 0] = np.eye(3)
    whole = half @ half
    for k in range(m):
        R[:, k + 1] = R[:, k] @ whole[:, k]
    G1, G2 = _integrals(phi)
    dv = np.matvec(R[:, :m], np.matvec(G1, force)) * dt[..., None]
    dp_own = np.matvec(R[:, :m], np.matvec(G2, force)) * (dt * dt)[..., None]
    v = np.cumsum(dv, axis=1)
    dp = (v - dv) * dt[..., None] + dp_own
    p = np.cumsum(dp, axis=1)
    t = np.cumsum(dt, axis=1)
    T, delta_v, delta_p, delta_R = t[:, -1], v[:, -1], p[:, -1], R[:, -1]
    # What enters in the middle of a piece: its way to the end of the interval.
    R_mid = R[:, :m] @ half
    v_mid, p_mid = v - 0.5 * dv, p - 0.5 * dp
    left = T[:, None] - t + 0.5 * dt
    to_theta = np.swapaxes(delta_R, 1, 2)[:, None] @ R_mid
    to_v = -so3.hat(delta_v[:, None] - v_mid) @ R_mid
    to_p = -so3.hat(delta_p[:, None] - p_mid - v_mid * left[..., None]) @ R_mid
    w = dt[..., None, None]
    J = np.zeros((n, 9, 6))
    J[:, 0:3, 0:3] = -(to_theta * w).sum(axis=1)
    J[:, 3:6, 0:3] = -(to_v * w).sum(axis=1)
    J[:, 6:9, 0:3] = -(to_p * w).sum(axis=1)
    J[:, 3:6, 3:6] = -(R_mid * w).sum(axis=1)
    J[:, 6:9, 3:6] = -(R_mid * (w * left[..., None, None])).sum(axis=1)
    Q = np.zeros((n, 9, 9)) if noise is None else _noise(dt, to_theta, to_v, to_p, R_mid, left, noise)
    RT = np.swapaxes(R_mid, 2, 3)
    share = w / T[:, None, None, None]
    mean_RT = (RT * share).sum(axis=1)
    mean_tRT = (RT * (share * (T[:, None] - left)[..., None, None])).sum(axis=1)
    mean_RTv = (np.matvec(RT, v_mid) * share[..., 0]).sum(axis=1)
    return Increments(T, delta_R, delta_v, delta_p, J, Q, mean_RT, mean_tRT, mean_RTv)


def coverage(samples: ImuSamples) -> tuple[int, int]:
    """First and last time [ns] for which there is a sample: half an interval beyond the first and last stamp."""
    if len(samples) < 2:
        raise ConfigError(f"{len(samples)} IMU samples; two are needed")
    t = samples.t_ns
    return int(t[0] - (t[1] - t[0]) // 2), int(t[-1] + (t[-1] - t[-2]) // 2)


def bounds(t_ns: Stamps) -> Stamps:
    """(N + 1,) where one of N samples ends and the next begins."""
    middle = t_ns[:-1] + np.diff(t_ns) // 2
    return np.concatenate([[t_ns[0] - (t_ns[1] - t_ns[0]) // 2], middle, [t_ns[-1] + (t_ns[-1] - t_ns[-2]) // 2]])


def _pieces(t_ns: Stamps, edges_ns: Stamps) -> tuple[Floats, Stamps]:
    """Parts of samples between edges: (N, M) s, 0 where there is none, and which sample."""
    cells = bounds(t_ns)
    inside = cells[(cells > edges_ns[0]) & (cells < edges_ns[-1])]
    cuts = np.union1d(inside, edges_ns)
    dt = np.diff(cuts) * 1e-9
    sample = np.clip(np.searchsorted(cells, cuts[:-1], side="right") - 1, 0, len(t_ns) - 1)
    interval = np.searchsorted(edges_ns, cuts[:-1], side="right") - 1
    begin = np.searchsorted(interval, np.arange(len(edges_ns) - 1))
    rank = np.arange(len(dt)) - begin[interval]
    shape = (len(edges_ns) - 1, int(rank.max()) + 1)
    lengths, index = np.zeros(shape), np.zeros(shape, dtype=np.int64)
    lengths[interval, rank], index[interval, rank] = dt, sample
    return lengths, index


def _integrals(phi: Vectors) -> tuple[Floats, Floats]:
    """Mean of Exp(s phi) over s in [0, 1], and of (1 - s) Exp(s phi): (..., 3) to two (..., 3, 3).

    Series to phi^3: angles within a sample are small (at 35 rad/s and 200 Hz the rest is 2e-5).
    """
    K = so3.hat(phi)
    KK = K @ K
    eye = np.eye(3)
    s = np.sum(phi * phi, axis=-1)[..., None, None]
    G1 = eye + (0.5 - s / 24.0) * K + (1.0 / 6.0 - s / 120.0) * KK
    G2 = 0.5 * eye + (1.0 / 6.0 - s / 120.0) * K + (1.0 / 24.0 - s / 720.0) * KK
    return G1, G2


def _noise(
    dt: Floats, to_theta: Floats, to_v: Floats, to_p: Floats, R_mid: Rotations, left: Floats, noise: ImuNoise
) -> Floats:
    """(N, 9, 9): white noise of each piece, carried to the end of its interval."""
    n, m = dt.shape
    A = np.zeros((n, m, 9, 6))
    A[:, :, 0:3, 0:3], A[:, :, 3:6, 0:3], A[:, :, 6:9, 0:3] = to_theta, to_v, to_p
    A[:, :, 3:6, 3:6] = R_mid
    A[:, :, 6:9, 3:6] = R_mid * left[..., None, None]
    density = np.repeat([noise.gyroscope_noise_density, noise.accelerometer_noise_density], 3)
    A *= density * np.sqrt(dt)[..., None, None]
    root = np.moveaxis(A, 2, 1).reshape(n, 9, m * 6)
    return root @ np.swapaxes(root, 1, 2)

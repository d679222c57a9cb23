"""A first guess of a state in motion: gyro bias from rotations, velocity and gravity in closed form.

docs/filter.md, section 6.
"""

import numpy as np
from scipy.optimize import brentq

from msckf.propagation import Increment
from msckf.views import Views
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Vectors
from navcore.imu import GRAVITY
from navcore.prior import BiasPrior

_STEPS = 10
_BEARING_SIGMA = 1e-3  # rad
_DIFFERENCE = 1e-5  # rad/s, for the derivative by the bias

_Pairs = tuple[Vectors, Vectors, Mask, Rotations, Floats]
"""Bearings in B of all features in P pairs of views, twice (P, F, 3), whether both see them (P, F, 1), the rotation
from the second to the first (P, 3, 3) and its derivative by the gyro's bias, on the right (P, 3, 3)."""


def rotation_bias(views: Views, increments: list[Increment], device: BiasPrior) -> Vectors:
    """Gyro bias (3,) under which the bearings of features agree with the gyro's rotations.

    For two views with rotation R, the normals of all epipolar planes, f_0 x R f_1, lie in one plane: the smallest
    eigenvalue of their scatter vanishes at the right R whatever the translation (Kneip and Lynen 2013, "Direct
    optimization of frame-to-frame rotation", eq. 5; He et al. 2023, "A rotation-translation-decoupled solution for
    robust and efficient visual-inertial initialization", eq. 12).

    Args:
        views: features.
        increments: between the poses, integrated at the device's biases.
        device: what is known of the biases beforehand.
    """
    K = views.count
    db = np.zeros(3)
    for steps in ((1, 3), (max(K // 3, 1), max(2 * K // 3, 2))):  # close pairs find the valley, wide ones its bottom
        pairs = _pairs(views, increments, steps)
        if pairs is not None:
            db = _agreed(pairs, db, np.sqrt(np.diagonal(device.covariance)[:3]))
    return np.asarray(device.b_g + db)


def _agreed(pairs: _Pairs, db: Vectors, sigma: Vectors) -> Vectors:
    """Change of the bias, from `db` on, that pairs of views agree with; it is zero within `sigma` (3,)."""
    f_i, f_j, both, R, J = pairs

    def residuals(db: Floats) -> Floats:
        """Of biases (N, 3): (N, P + 3)."""
        turned = R @ so3.exp((J @ db[:, None, :, None])[..., 0])  # (N, P, 3, 3)
        normals = so3.cross(f_i, f_j @ np.swapaxes(turned, -1, -2)) * both
        scatter = np.swapaxes(normals, -1, -2) @ normals
        smallest = np.sqrt(np.maximum(np.linalg.eigvalsh(scatter)[..., 0], 0.0))
        return np.concatenate([smallest / _BEARING_SIGMA, db / sigma], axis=1)

    damping = 1e-3
    r = residuals(db[None])[0]
    for _ in range(_STEPS):
        H = (residuals(db + _DIFFERENCE * np.eye(3)) - r).T / _DIFFERENCE
        A = H.T @ H
        step = -np.linalg.solve(A + damping * np.diag(np.diagonal(A)), H.T @ r)
        new = residuals((db + step)[None])[0]
        if new @ new < r @ r:
            gained = 1.0 - (new @ new) / (r @ r)
            db, r, damping = db + step, new, 0.1 * damping
            if gained < 1e-4:
                break
        else:
            damping *= 10.0
    return db


def _pairs(views: Views, increments: list[Increment], steps: tuple[int, int]) -> _Pairs | None:
    """Pairs of views whose poses are so many steps apart; None if no pair has enough features in common."""
    bearings = (views.rig.R_BC[views.cameras] @ views.rays[..., None])[..., 0]
    found = []
    for i in range(len(views.poses)):
        R, J = np.eye(3), np.zeros((3, 3))
        for j in range(i + 1, len(views.poses)):
            if views.poses[j] > views.poses[j - 1]:
                inc = increments[views.poses[j] - 1]
                J = inc.delta_R.T @ J + inc.J[:3, :3]
                R = R @ inc.delta_R
            step = views.poses[j] - views.poses[i]
            if step > steps[1]:
                break
            both = views.seen[:, i] & views.seen[:, j]
            if step in steps and both.sum() >= 8:
                found.append((bearings[:, i], bearings[:, j], both[:, None], R, J))
    if not found:
        return None
    f_i, f_j, both, R, J = (np.stack(parts) for parts in zip(*found, strict=True))
    return f_i, f_j, both, R, J


def closed_form(views: Views, increments: list[Increment]) -> tuple[Vectors, Vectors] | None:
    """Velocity and gravity (3,), (3,) at the first pose in its body frame, |g| held at its value.

    Every view of a feature gives two linear equations in the feature, the velocity and gravity, since
    p_k = v t + g t^2/2 + (what the IMU integrated); features are eliminated one by one (Dong-Si and Mourikis 2012,
    "Estimator initialization in vision-aided inertial navigation with unknown camera-IMU calibration", eqs. 26-33).
    Distances from rays count by the feature's own: twice, the second time with the distances found first.
    """
    K = views.count
    R, s, t = np.empty((K, 3, 3)), np.zeros((K, 3)), np.zeros(K)
    R[0], v = np.eye(3), np.zeros(3)
    for k, inc in enumerate(increments):
        s[k + 1] = s[k] + v * inc.dt + R[k] @ inc.delta_p
        v = v + R[k] @ inc.delta_v
        R[k + 1] = R[k] @ inc.delta_R
        t[k + 1] = t[k] + inc.dt
    R_0C, q = views.camera_poses(R, s)
    rays = (R_0C @ views.rays[..., None])[..., 0]
    across = (np.eye(3) - rays[..., :, None] * rays[..., None, :]) * views.seen[..., None, None]
    t = t[views.poses]
    T = np.concatenate([t[:, None, None] * np.eye(3), 0.5 * (t * t)[:, None, None] * np.eye(3)], axis=2)  # (V, 3, 6)
    PT = across @ T[None]  # (F, V, 3, 6)
    Pq = (across @ q[..., None])[..., 0]
    A = across.sum(axis=1) + 1e-9 * np.eye(3)
    B, c = PT.sum(axis=1), Pq.sum(axis=1)
    AB, Ac = np.linalg.solve(A, B), np.linalg.solve(A, c[..., None])[..., 0]
    M_f = np.einsum("via,fvib->fab", T, PT) - np.swapaxes(B, -1, -2) @ AB
    m_f = -np.einsum("via,fvi->fa", T, Pq) + (np.swapaxes(B, -1, -2) @ Ac[..., None])[..., 0]
    if len(A) < 6:
        return None
    found = _with_gravity_norm(M_f.sum(axis=0), m_f.sum(axis=0))
    if found is None:
        return None
    y = np.concatenate(found)
    p = AB @ y + Ac  # (F, 3) the features
    middle = (views.seen[..., None] * (q + T @ y)).sum(axis=1) / views.seen.sum(axis=1)[:, None]
    weight = 1.0 / np.clip(np.sum((p - middle) ** 2, axis=1), 0.1, None)
    return _with_gravity_norm(np.einsum("f,fab->ab", weight, M_f), weight @ m_f) or found


def _with_gravity_norm(M: Floats, m: Floats) -> tuple[Vectors, Vectors] | None:
    """Minimise y^T M y - 2 m^T y over y = (v, g) with |g| given, by its secular equation."""
    M_vv, M_vg, M_gg = M[:3, :3], M[:3, 3:], M[3:, 3:]
    if np.linalg.cond(M_vv) > 1e12:
        return None
    D = M_gg - M_vg.T @ np.linalg.solve(M_vv, M_vg)
    d = m[3:] - M_vg.T @ np.linalg.solve(M_vv, m[:3])
    values, vectors = np.linalg.eigh(0.5 * (D + D.T))
    q = vectors.T @ d

    def excess(shift: float) -> float:
        return float(np.sum((q / (values + shift)) ** 2) - GRAVITY**2)

    low = -values[0] + 1e-12 * max(values[-1], 1e-12)
    high = -values[0] + np.linalg.norm(q) / GRAVITY + values[-1]
    if not (np.isfinite(excess(low)) and excess(low) > 0.0 > excess(high)):
        return None
    g = vectors @ (q / (values + brentq(excess, low, high, xtol=1e-14)))
    v = np.asarray(np.linalg.solve(M_vv, m[:3] - M_vg @ g), dtype=np.float64)
    return v, g

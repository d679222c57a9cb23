"""Start in motion: gyro bias from rotations, velocity and gravity in closed form, then all of it refined together.

docs/filter.md, section 6.
"""

import numpy as np
from scipy.optimize import brentq, least_squares

from msckf.config import StartConfig, VisionConfig
from msckf.propagation import Increment
from msckf.start_refinement import StartResult, Window, path_from, refine
from navcore import so3
from navcore.arrays import Floats, Vectors
from navcore.imu import GRAVITY


def moving_start(window: Window, config: StartConfig, vision: VisionConfig) -> StartResult:
    """Find the state at the end of a window of a moving rig."""
    if window.views.seen[:, -len(window.views.rig) :].any(axis=1).sum() < 8:
        return StartResult(None, "too few features are followed")
    b_g = rotation_bias(window)
    increments = window.integrate(b_g, window.device.b_a)
    guess = closed_form(window, increments)
    if guess is None:
        return StartResult(None, "motion does not determine velocity and gravity")
    v_B, g_B = guess
    path = path_from(increments, v_B, g_B, b_g, window.device.b_a)
    return refine(window, path, config, vision)


def rotation_bias(window: Window) -> Vectors:
    """Gyro bias (3,) under which the bearings of features agree with the gyro's rotations.

    For two views with rotation R, the normals of all epipolar planes, f_0 x R f_1, lie in one plane: the smallest
    eigenvalue of their scatter vanishes at the right R whatever the translation (Kneip and Lynen 2013, "Direct
    optimization of frame-to-frame rotation", eq. 5; He et al. 2023, "A rotation-translation-decoupled solution for
    robust and efficient visual-inertial initialization", eq. 12).
    """
    views, device = window.views, window.device
    increments = window.integrate(device.b_g, device.b_a)
    bearings = (views.rig.R_BC[views.cameras] @ views.rays[..., None])[..., 0]  # (F, V, 3) in B
    C = len(views.rig)
    pairs = [(v, v + C * step) for step in (1, 3) for v in range(C * (views.count - step))]
    usable = []
    for i, j in pairs:
        both = views.seen[:, i] & views.seen[:, j]
        if both.sum() < 8:
            continue
        R, J = np.eye(3), np.zeros((3, 3))  # rotation from j to i, its derivative by the bias (on the right)
        for inc in increments[i // C : j // C]:
            J = inc.delta_R.T @ J + inc.J[:3, :3]
            R = R @ inc.delta_R
        usable.append((bearings[both, i], bearings[both, j], R, J))
    if not usable:
        return np.array(device.b_g)

    sigma = np.sqrt(np.diagonal(device.covariance)[:3])

    def residuals(db: Floats) -> Floats:
        out = []
        for f_i, f_j, R, J in usable:
            normals = so3.cross(f_i, f_j @ (R @ so3.exp(J @ db)).T)
            scatter = normals.T @ normals
            out.append(np.sqrt(max(float(np.linalg.eigvalsh(scatter)[0]), 0.0)))
        return np.concatenate([np.array(out) * 1e3, db / sigma])

    solution = least_squares(residuals, np.zeros(3), method="lm", x_scale=0.01, max_nfev=80)
    return np.asarray(device.b_g + solution.x)


def closed_form(window: Window, increments: list[Increment]) -> tuple[Vectors, Vectors] | None:
    """Velocity and gravity (3,), (3,) at the first pose in its body frame, |g| held at its value.

    Every view of a feature gives two linear equations in the feature, the velocity and gravity, since
    p_k = v t + g t^2/2 + (what the IMU integrated); features are eliminated one by one (Dong-Si and Mourikis 2012,
    "Estimator initialization in vision-aided inertial navigation with unknown camera-IMU calibration", eqs. 26-33).
    """
    views = window.views
    K = views.count
    R, s, t = np.empty((K, 3, 3)), np.zeros((K, 3)), np.zeros(K)
    R[0], v = np.eye(3), np.zeros(3)
    for k, inc in enumerate(increments):
        s[k + 1] = s[k] + v * inc.dt + R[k] @ inc.delta_p
        v = v + R[k] @ inc.delta_v
        R[k + 1] = R[k] @ inc.delta_R
        t[k + 1] = t[k] + inc.dt
    R_0C, p_0C = views.camera_poses(R, s)
    rays = (R_0C @ views.rays[..., None])[..., 0]
    across = (np.eye(3) - rays[..., :, None] * rays[..., None, :]) * views.seen[..., None, None]
    T = np.concatenate([t[:, None, None] * np.eye(3), 0.5 * (t * t)[:, None, None] * np.eye(3)], axis=2)  # (K, 3, 6)
    T = T[views.poses]  # (V, 3, 6)
    PT = across @ T[None]  # (F, V, 3, 6)
    Ps = (across @ p_0C[..., None])[..., 0]
    enough = views.seen.sum(axis=1) >= 3
    A = across.sum(axis=1)[enough]
    if len(A) < 6:
        return None
    A = A + 1e-9 * np.eye(3)
    B, c = PT.sum(axis=1)[enough], Ps.sum(axis=1)[enough]
    M = np.einsum("kia,fkib->ab", T, PT[enough]) - np.einsum("fia,fib->ab", B, np.linalg.solve(A, B))
    m = -np.einsum("kia,fki->a", T, Ps[enough]) + np.einsum("fia,fi->a", B, np.linalg.solve(A, c[..., None])[..., 0])
    return _with_gravity_norm(M, m)


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

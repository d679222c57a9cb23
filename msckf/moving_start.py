"""Start in motion: gyro bias from rotations, velocity and gravity in closed form, then all of it refined together.

docs/filter.md, section 6.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, least_squares

from msckf.config import StartConfig, VisionConfig
from msckf.imu_buffer import Cells
from msckf.propagation import Increment, integrate, noise_in_world, predict, transition
from msckf.static_start import gravity_aligned
from msckf.triangulation import triangulate
from msckf.views import Views
from msckf.visual import linearise, project_out
from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors
from navcore.imu import GRAVITY, ImuNoise
from navcore.odometry import State
from navcore.prior import BiasPrior

_STEPS = 12
_GAUGE_SIGMA = 1e-6  # m and rad, position and yaw of the first pose
_FREE_VELOCITY_SIGMA = 10.0  # m/s
_GATE = 3.5  # pixel noises, mean reprojection error of a feature that is kept


@dataclass(frozen=True)
class Window:
    """What a start in motion looks at.

    Attributes:
        cells: IMU between consecutive poses, K - 1 of them.
        views: features over the K poses.
        noise: of the IMU.
        device: what is known of the biases beforehand.
    """

    cells: list[Cells]
    views: Views
    noise: ImuNoise
    device: BiasPrior

    def integrate(self, b_g: Vectors, b_a: Vectors) -> list[Increment]:
        """The increments between the poses."""
        return [integrate(cells, b_g, b_a, self.noise) for cells in self.cells]


@dataclass(frozen=True)
class StartResult:
    """A start, or the reason why there is none.

    Attributes:
        state: at the window's last pose, in a frame with the first pose at the origin and yaw 0; or None.
        reason: empty if there is a state.
    """

    state: State | None
    reason: str = ""


@dataclass
class _Path:
    """Poses, velocities and biases at the window's poses."""

    R: Rotations  # (K, 3, 3)
    p: Vectors  # (K, 3)
    v: Vectors  # (K, 3)
    b_g: Vectors  # (K, 3)
    b_a: Vectors  # (K, 3)


def moving_start(window: Window, config: StartConfig, vision: VisionConfig) -> StartResult:
    """Find the state at the end of a window of a moving rig."""
    if window.views.seen[:, -1].sum() < 8:
        return StartResult(None, "too few features are followed")
    b_g = rotation_bias(window)
    increments = window.integrate(b_g, window.device.b_a)
    guess = closed_form(window, increments)
    if guess is None:
        return StartResult(None, "motion does not determine velocity and gravity")
    v_B, g_B = guess
    path = _path_from(increments, v_B, g_B, b_g, window.device.b_a)
    return _refine(window, path, config, vision)


def rotation_bias(window: Window) -> Vectors:
    """Gyro bias (3,) under which the bearings of features agree with the gyro's rotations.

    For two views with rotation R, the normals of all epipolar planes, f_0 x R f_1, lie in one plane: the smallest
    eigenvalue of their scatter vanishes at the right R whatever the translation (Kneip and Lynen 2013, "Direct
    optimization of frame-to-frame rotation", eq. 5; He et al. 2023, "A rotation-translation-decoupled solution for robust
    and efficient visual-inertial initialization", eq. 12).
    """
    views, device = window.views, window.device
    increments = window.integrate(device.b_g, device.b_a)
    bearings_C = views.rig.unproject(views.cameras, views.uv)
    bearings = (views.rig.R_BC[views.cameras][:, None] @ bearings_C[..., None])[..., 0]  # (F, K, 3) in B
    K = views.seen.shape[1]
    pairs = [(k, k + step) for step in (1, 3) for k in range(K - step)]
    usable = []
    for i, j in pairs:
        both = views.seen[:, i] & views.seen[:, j]
        if both.sum() < 8:
            continue
        R, J = np.eye(3), np.zeros((3, 3))  # rotation from j to i, its derivative by the bias (on the right)
        for inc in increments[i:j]:
            J = inc.delta_R.T @ J + inc.J[:3, :3]
            R = R @ inc.delta_R
        usable.append((bearings[both, i], bearings[both, j], R, J))
    if not usable:
        return np.array(device.b_g)

    sigma = np.sqrt(np.diagonal(device.covariance)[:3])

    def residuals(db: Floats) -> Floats:
        out = []
        for f_i, f_j, R, J in usable:
            normals = np.cross(f_i, f_j @ (R @ so3.exp(J @ db)).T)
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
    K = views.seen.shape[1]
    R, s, t = np.empty((K, 3, 3)), np.zeros((K, 3)), np.zeros(K)
    R[0], v = np.eye(3), np.zeros(3)
    for k, inc in enumerate(increments):
        s[k + 1] = s[k] + v * inc.dt + R[k] @ inc.delta_p
        v = v + R[k] @ inc.delta_v
        R[k + 1] = R[k] @ inc.delta_R
        t[k + 1] = t[k] + inc.dt
    R_0C, p_0C = views.camera_poses(R, s)
    rays = (R_0C @ views.rig.unproject(views.cameras, views.uv)[..., None])[..., 0]
    across = (np.eye(3) - rays[..., :, None] * rays[..., None, :]) * views.seen[..., None, None]
    T = np.concatenate([t[:, None, None] * np.eye(3), 0.5 * (t * t)[:, None, None] * np.eye(3)], axis=2)  # (K, 3, 6)
    PT = across @ T[None]  # (F, K, 3, 6)
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
    v = np.linalg.solve(M_vv, m[:3] - M_vg @ g)
    return v, g


def _path_from(increments: list[Increment], v_B: Vectors, g_B: Vectors, b_g: Vectors, b_a: Vectors) -> _Path:
    """The path that follows from velocity and gravity at the first pose."""
    R, p, v = gravity_aligned(-g_B), np.zeros(3), v_B
    v = R @ v
    poses = [(R, p, v)]
    for inc in increments:
        poses.append(predict(*poses[-1], inc))
    K = len(poses)
    R_all, p_all, v_all = (np.stack([pose[i] for pose in poses]) for i in range(3))
    return _Path(R_all, p_all, v_all, np.tile(b_g, (K, 1)), np.tile(b_a, (K, 1)))


def _refine(window: Window, path: _Path, config: StartConfig, vision: VisionConfig) -> StartResult:
    """Gauss-Newton over all poses, velocities and biases; features are projected out as in the filter."""
    views = window.views
    previous = np.inf
    damping = 1e-3
    for step in range(_STEPS):
        system = _linearise(window, views, path, vision)
        if system is None:
            return StartResult(None, "features cannot be triangulated")
        A, b, cost, rms, rms_known = system
        if step >= 2:  # the path is near: outliers stand out
            keep = ~rms_known | (rms < _GATE * vision.pixel_noise)
            if not keep.all():
                views = views.rows(keep)
                if len(views.uv) < 8:
                    return StartResult(None, "features do not fit one motion")
                previous = np.inf
                continue
        if step >= 3 and abs(previous - cost) < 1e-3 * cost:
            break
        damping = damping * 0.1 if cost < previous else damping * 10.0
        previous = cost
        scale = np.linalg.norm(A, axis=0)
        dx = np.linalg.lstsq(
            np.vstack([A / scale, np.sqrt(damping) * np.eye(len(scale))]),
            np.concatenate([b, np.zeros(len(scale))]),
            rcond=None,
        )[0]
        _move(path, dx / scale)
        if not np.isfinite(dx).all() or np.abs(path.v).max() > 50.0:
            return StartResult(None, "refinement runs away")
    else:
        return StartResult(None, "refinement does not settle")
    return _accept(path, A, cost, views, config)


def _linearise(
    window: Window, views: Views, path: _Path, vision: VisionConfig
) -> tuple[Floats, Floats, float, Floats, Floats] | None:
    """Whitened A, b of the least-squares problem, its cost, and each feature's rms [px] with whether it has one."""
    K = len(path.R)
    n = 15 * K
    rows, rights = [], []

    def add(J: Floats, r: Floats) -> None:
        rows.append(J)
        rights.append(r)

    sigma = np.full(6, _GAUGE_SIGMA)
    gauge = np.zeros((4, n))
    gauge[0:3, 3:6] = np.eye(3)
    gauge[3, 0:3] = path.R[0][2]  # yaw: rotation about W's z
    add(gauge / _GAUGE_SIGMA, np.concatenate([-path.p[0], [0.0]]) / _GAUGE_SIGMA)
    speed = np.zeros((3, n))
    speed[:, 6:9] = np.eye(3)
    add(speed / _FREE_VELOCITY_SIGMA, -path.v[0] / _FREE_VELOCITY_SIGMA)
    bias = np.zeros((6, n))
    bias[:, 9:15] = np.eye(6)
    L = np.linalg.inv(np.linalg.cholesky(window.device.covariance))
    difference = window.device.vector - np.concatenate([path.b_g[0], path.b_a[0]])
    add(L @ bias, L @ difference)

    for k in range(K - 1):
        inc = integrate(window.cells[k], path.b_g[k], path.b_a[k], window.noise)
        start = (path.R[k], path.p[k], path.v[k])
        end = predict(*start, inc)
        Phi, Q = transition(inc, start, end), noise_in_world(inc, path.R[k])
        r = np.concatenate(
            [
                so3.log(end[0].T @ path.R[k + 1]),
                path.p[k + 1] - end[1],
                path.v[k + 1] - end[2],
                path.b_g[k + 1] - path.b_g[k],
                path.b_a[k + 1] - path.b_a[k],
            ]
        )
        d = np.sqrt(np.diagonal(Q)) + 1e-9
        W = np.linalg.inv(np.linalg.cholesky(Q / np.outer(d, d) + 1e-9 * np.eye(15))) / d
        J = np.zeros((15, n))
        J[:, 15 * (k + 1) : 15 * (k + 2)] = W
        J[0:15, 15 * (k + 1) : 15 * (k + 1) + 3] = W[:, :3] @ so3.right_jacobian_inverse(r[:3])
        J[:, 15 * k : 15 * (k + 1)] = -W @ Phi
        add(J, -W @ r)

    points = triangulate(views, path.R, path.p, vision)
    if points.valid.sum() < 8:
        return None
    seen = views.rows(points.valid)
    r_px, H_x, H_f = linearise(seen, path.R, path.p, path.R, path.p, points.p_WF[points.valid])
    r_px, H = project_out(r_px, H_x, H_f)
    weight = 1.0 / (vision.pixel_noise * np.sqrt(1.0 + (points.rms[points.valid] / (3.0 * vision.pixel_noise)) ** 2))
    visual = np.zeros((H.shape[0] * H.shape[1], n))
    columns = (15 * np.arange(K)[:, None] + np.arange(6)).ravel()
    visual[:, columns] = (H * weight[:, None, None]).reshape(-1, 6 * K)
    squeezed = np.linalg.qr(np.column_stack([visual[:, columns], (r_px * weight[:, None]).ravel()]), mode="r")
    m = min(len(squeezed), 6 * K)
    compact = np.zeros((m, n))
    compact[:, columns] = squeezed[:m, : 6 * K]
    add(compact, squeezed[:m, 6 * K])
    A, b = np.vstack(rows), np.concatenate(rights)
    outside = float(np.sum(squeezed[m:, 6 * K] ** 2))
    del sigma
    return A, b, float(b @ b) + outside, points.rms, points.valid


def _move(path: _Path, dx: Floats) -> None:
    d = dx.reshape(-1, 15)
    path.R = so3.normalise(path.R @ so3.exp(d[:, 0:3]))
    path.p = path.p + d[:, 3:6]
    path.v = path.v + d[:, 6:9]
    path.b_g = path.b_g + d[:, 9:12]
    path.b_a = path.b_a + d[:, 12:15]


def _accept(path: _Path, A: Floats, cost: float, views: Views, config: StartConfig) -> StartResult:
    """The last state with its covariance, if it is known well enough."""
    scale = np.linalg.norm(A, axis=0)
    R_factor = np.linalg.qr(A / scale, mode="r")
    last = np.linalg.solve(R_factor.T, np.eye(len(scale))[:, -15:])  # columns of R^-T
    P = (last.T @ last) / np.outer(scale[-15:], scale[-15:])
    dof = max(2.0 * views.seen.sum() - 3.0 * len(views.uv), 1.0)
    velocity_sigma = float(np.sqrt(np.diagonal(P)[6:9].max()))
    tilt_sigma = float(np.sqrt(np.diagonal(path.R[-1] @ P[:3, :3] @ path.R[-1].T)[:2].max()))
    if not np.isfinite(P).all() or velocity_sigma > config.max_velocity_sigma or tilt_sigma > config.max_tilt_sigma:
        return StartResult(None, f"velocity known to {velocity_sigma:.2f} m/s, tilt to {tilt_sigma:.3f} rad only")
    if cost / dof > 4.0:
        return StartResult(None, f"features and IMU disagree: cost {cost / dof:.1f} per degree of freedom")
    state = State(path.R[-1], path.p[-1], path.v[-1], path.b_g[-1], path.b_a[-1], 0.5 * (P + P.T))
    return StartResult(state)

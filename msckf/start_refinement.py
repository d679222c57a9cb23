"""The last step of a start in motion: poses, velocities and biases of a window, refined together.

A maximum a posteriori estimate by Gauss-Newton, docs/filter.md, section 6. Its covariance is the filter's first.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from msckf.blocks import ACCEL_BIAS, BIASES, GYRO_BIAS, POSITION, THETA, VELOCITY
from msckf.config import StartConfig, VisionConfig
from msckf.imu_buffer import Cells
from msckf.propagation import Increment, integrate, noise_in_world, predict, transition
from msckf.static_start import gravity_aligned
from msckf.triangulation import triangulate
from msckf.views import Views
from msckf.visual import linearise, split
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Vectors
from navcore.imu import ImuNoise
from navcore.odometry import State
from navcore.prior import BiasPrior

_STEPS = 12
_GAUGE_SIGMA = 1e-6  # m and rad, position and yaw of the first pose
_FREE_VELOCITY_SIGMA = 10.0  # m/s
_MAX_SPEED = 50.0  # m/s, past it the refinement has run away
_MIN_FEATURES = 8
_GATE = 3.5  # pixel noises, rms reprojection error of a feature that is kept
_MAX_COST_PER_DOF = 4.0  # of a start that is accepted


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
class Path:
    """Poses, velocities and biases at the window's poses."""

    R: Rotations  # (K, 3, 3)
    p: Vectors  # (K, 3)
    v: Vectors  # (K, 3)
    b_g: Vectors  # (K, 3)
    b_a: Vectors  # (K, 3)


@dataclass(frozen=True)
class _System:
    """Whitened least squares: minimise |A dx - b|^2.

    Attributes:
        A, b: rows of the gauge, the prior, the IMU and the features.
        cost: squared whitened residuals at dx = 0, those that compression left out included.
        rms: (F,) px, reprojection error of each feature; triangulated: (F,) whether it has one.
    """

    A: Floats
    b: Floats
    cost: float
    rms: Floats
    triangulated: Mask


def path_from(increments: list[Increment], v_B: Vectors, g_B: Vectors, b_g: Vectors, b_a: Vectors) -> Path:
    """The path that follows from velocity and gravity at the first pose."""
    R = gravity_aligned(-g_B)
    poses = [(R, np.zeros(3), R @ v_B)]
    for increment in increments:
        poses.append(predict(*poses[-1], increment))
    K = len(poses)
    R_all, p_all, v_all = (np.stack([pose[i] for pose in poses]) for i in range(3))
    return Path(R_all, p_all, v_all, np.tile(b_g, (K, 1)), np.tile(b_a, (K, 1)))


def refine(window: Window, path: Path, config: StartConfig, vision: VisionConfig) -> StartResult:
    """Gauss-Newton over all poses, velocities and biases; features are projected out as in the filter."""
    views = window.views
    previous, damping = np.inf, 1e-3
    for step in range(_STEPS):
        system = _linearise(window, views, path, vision)
        if system is None:
            return StartResult(None, "features cannot be triangulated")
        if step >= 2:  # the path is near: outliers stand out
            keep = ~system.triangulated | (system.rms < _GATE * vision.pixel_noise)
            if not keep.all():
                views = views.rows(keep)
                if len(views.uv) < _MIN_FEATURES:
                    return StartResult(None, "features do not fit one motion")
                previous = np.inf
                continue
        if step >= 3 and abs(previous - system.cost) < 1e-3 * system.cost:
            return _accept(path, system, views, config)
        damping = damping * 0.1 if system.cost < previous else damping * 10.0
        previous = system.cost
        dx = _damped_step(system, damping)
        _move(path, dx)
        if not np.isfinite(dx).all() or np.abs(path.v).max() > _MAX_SPEED:
            return StartResult(None, "refinement runs away")
    return StartResult(None, "refinement does not settle")


def _damped_step(system: _System, damping: float) -> Floats:
    """Levenberg-Marquardt's step, damped by the columns' own scale."""
    scale = np.linalg.norm(system.A, axis=0)
    n = len(scale)
    damped = np.vstack([system.A / scale, np.sqrt(damping) * np.eye(n)])
    Q, R = np.linalg.qr(damped)
    step: Floats = solve_triangular(R, Q.T @ np.concatenate([system.b, np.zeros(n)])) / scale
    return step


def _linearise(window: Window, views: Views, path: Path, vision: VisionConfig) -> _System | None:
    """The system at `path`, or None if too few features can be triangulated."""
    points = triangulate(views, path.R, path.p, vision)
    if points.valid.sum() < _MIN_FEATURES:
        return None
    A_v, b_v, rest = _visual_rows(views.rows(points.valid), path, points.p_WF[points.valid], points.rms, vision)
    parts = [_prior_rows(path, window.device), (A_v, b_v)]
    parts += [_imu_rows(window, path, k) for k in range(len(path.R) - 1)]
    A, b = np.vstack([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    return _System(A, b, float(b @ b) + rest, points.rms, points.valid)


def _prior_rows(path: Path, device: BiasPrior) -> tuple[Floats, Floats]:
    """The gauge (position and yaw of the first pose), a hardly known velocity, what is known of the biases."""
    n = 15 * len(path.R)
    gauge = np.zeros((4, n))
    gauge[0:3, POSITION] = np.eye(3)
    gauge[3, THETA] = path.R[0][2]  # yaw: rotation about W's z
    speed = np.zeros((3, n))
    speed[:, VELOCITY] = np.eye(3)
    bias = np.zeros((6, n))
    bias[:, BIASES] = np.eye(6)
    W = np.linalg.inv(np.linalg.cholesky(device.covariance))
    unexplained = device.vector - np.concatenate([path.b_g[0], path.b_a[0]])
    A = np.vstack([gauge / _GAUGE_SIGMA, speed / _FREE_VELOCITY_SIGMA, W @ bias])
    b = [-path.p[0] / _GAUGE_SIGMA, np.zeros(1), -path.v[0] / _FREE_VELOCITY_SIGMA, W @ unexplained]
    return A, np.concatenate(b)


def _imu_rows(window: Window, path: Path, k: int) -> tuple[Floats, Floats]:
    """What the IMU says about poses k and k + 1."""
    increment = integrate(window.cells[k], path.b_g[k], path.b_a[k], window.noise)
    start = (path.R[k], path.p[k], path.v[k])
    end = predict(*start, increment)
    Phi, Q = transition(increment, start, end), noise_in_world(increment, path.R[k])
    rotation = so3.log(end[0].T @ path.R[k + 1])
    biases = (path.b_g[k + 1] - path.b_g[k], path.b_a[k + 1] - path.b_a[k])
    r = np.concatenate([rotation, path.p[k + 1] - end[1], path.v[k + 1] - end[2], *biases])
    sigma = np.sqrt(np.diagonal(Q)) + 1e-9
    W = np.linalg.inv(np.linalg.cholesky(Q / np.outer(sigma, sigma) + 1e-9 * np.eye(15))) / sigma
    A = np.zeros((15, 15 * len(path.R)))
    A[:, 15 * k : 15 * (k + 1)] = -W @ Phi
    A[:, 15 * (k + 1) : 15 * (k + 2)] = W
    A[:, 15 * (k + 1) : 15 * (k + 1) + 3] = W[:, :3] @ so3.right_jacobian_inverse(rotation)
    return A, -W @ r


def _visual_rows(
    views: Views, path: Path, features: Vectors, rms: Floats, vision: VisionConfig
) -> tuple[Floats, Floats, float]:
    """What the features say about the poses, compressed, and the squared residual that no pose can explain."""
    K = len(path.R)
    r, H_x, H_f, _ = linearise(views, path.R, path.p, path.R, path.p, features)
    parts = split(views, r, H_x, H_f)
    s = vision.pixel_noise
    weight = 1.0 / (s * np.sqrt(1.0 + (rms[np.isfinite(rms)] / (3.0 * s)) ** 2))  # Cauchy's, per feature
    H, r = parts.H * weight[:, None, None], parts.r * weight[:, None]
    stacked = np.column_stack([H.reshape(-1, 6 * K), r.ravel()])
    R_factor: Floats = np.linalg.qr(stacked, mode="r")  # type: ignore[assignment]
    m = min(len(R_factor), 6 * K)
    A = np.zeros((m, 15 * K))
    A[:, (15 * np.arange(K)[:, None] + np.arange(6)).ravel()] = R_factor[:m, : 6 * K]
    return A, R_factor[:m, 6 * K], float(np.sum(R_factor[m:, 6 * K] ** 2))


def _move(path: Path, dx: Floats) -> None:
    d = dx.reshape(-1, 15)
    path.R = so3.normalise(path.R @ so3.exp(d[:, THETA]))
    path.p = path.p + d[:, POSITION]
    path.v = path.v + d[:, VELOCITY]
    path.b_g = path.b_g + d[:, GYRO_BIAS]
    path.b_a = path.b_a + d[:, ACCEL_BIAS]


def _accept(path: Path, system: _System, views: Views, config: StartConfig) -> StartResult:
    """The last state with its covariance, if it is known well enough."""
    scale = np.linalg.norm(system.A, axis=0)
    n = len(scale)
    R_factor: Floats = np.linalg.qr(system.A / scale, mode="r")  # type: ignore[assignment]
    last = solve_triangular(R_factor, np.eye(n)[:, -15:], trans="T")  # columns of R^-T
    P = (last.T @ last) / np.outer(scale[-15:], scale[-15:])
    R_WB = path.R[-1]
    velocity_sigma = float(np.sqrt(np.diagonal(P)[VELOCITY].max()))
    tilt_sigma = float(np.sqrt(np.diagonal(R_WB @ P[THETA, THETA] @ R_WB.T)[:2].max()))
    if not np.isfinite(P).all() or velocity_sigma > config.max_velocity_sigma or tilt_sigma > config.max_tilt_sigma:
        return StartResult(None, f"velocity known to {velocity_sigma:.2f} m/s, tilt to {tilt_sigma:.3f} rad only")
    seen = views.seen[system.triangulated]
    dof = max(2.0 * seen.sum() - 3.0 * len(seen), 1.0)
    if system.cost / dof > _MAX_COST_PER_DOF:
        return StartResult(None, f"features and IMU disagree: cost {system.cost / dof:.1f} per degree of freedom")
    return StartResult(State(R_WB, path.p[-1], path.v[-1], path.b_g[-1], path.b_a[-1], 0.5 * (P + P.T)))

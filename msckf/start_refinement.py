"""The last step of a start in motion: a window of poses and velocities, the biases and all points, refined together.

A maximum a posteriori estimate by Levenberg-Marquardt over the normal equations, with the points eliminated one by one
(docs/filter.md, section 6). Its covariance is the filter's first.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from msckf.blocks import VELOCITY
from msckf.start_inertia import Inertia, Path, Window
from msckf.start_points import Points, Sight, last_origins
from msckf.views import Views
from navcore.arrays import Floats

_STEPS = 12  # of each of the two rounds
_LEAST_FEATURES = 8
_SPEED_SIGMA = 10.0  # m/s, of a velocity that nothing is known of
_MAX_SPEED = 50.0  # m/s, past it the refinement has run away
_CAUCHY = 3.0  # pixel noises, from which on a feature counts less
_GATE = 4.0  # pixel noises, rms reprojection error of a feature that stays for the second round
_CORRELATION = 2.0  # errors of a track are alike from frame to frame: as much more noise as the residuals show
_LEAST_NOISE = 0.25  # px, no track is better
_SETTLED = (0.05, 1e-4)  # change of the cost, absolute and relative
_DAMPING = (1e-5, 1e-9)  # of the first step, and the least


@dataclass(frozen=True)
class Refined:
    """A window that was refined.

    Attributes:
        path, points: the estimate.
        covariance: (9 K + 6, 9 K + 6) of its error, in the order of `Path.moved`; position and yaw of the last
            pose have none: they are the gauge.
        cost: chi-square of features, IMU and what was known beforehand, at the pixel noise that was assumed first.
        dof: its degrees of freedom.
        pixel_noise: px, as the window shows it.
    """

    path: Path
    points: Points
    covariance: Floats
    cost: float
    dof: float
    pixel_noise: float


@dataclass(frozen=True)
class _Normal:
    """Normal equations N dx = b of path and points, at some path and points.

    Attributes:
        N, b: (n, n), (n,) of the path alone.
        N_fx: (F, 3, 6 K) of a point and all poses; N_f: (F, 3, 3); b_f: (F, 3).
        cost: of robust weights.
        rms: (F,) px, reprojection error; infinite for a point behind a camera.
    """

    N: Floats
    b: Floats
    N_fx: Floats
    N_f: Floats
    b_f: Floats
    cost: float
    rms: Floats


class _Problem:
    """The least squares problem of a window."""

    def __init__(self, window: Window, views: Views, inertia: Inertia, pixel_noise: float) -> None:
        self.views, self.pixel_noise = views, pixel_noise
        self.count = views.seen.sum(axis=1)
        self._device, self._inertia = window.device, inertia
        self._information = np.linalg.inv(window.device.covariance)
        K = views.count
        self._poses = (9 * np.arange(K)[:, None] + np.arange(6)).ravel()  # dtheta, dp of all
        self._last = slice(9 * (K - 1), 9 * (K - 1) + 3)  # dtheta of the last pose
        self._free = np.delete(np.arange(9 * K + 6), self._last.start + np.arange(2, 6))

    def linearise(self, path: Path, points: Points) -> _Normal:
        """The normal equations."""
        N, b, cost = self._of_the_path(path)
        sight = Sight.of(self.views, path.R, path.p, points)
        F, V, K, s = len(self.views.seen), len(self.views.poses), self.views.count, self.pixel_noise
        rms = np.sqrt(np.sum(sight.r**2, axis=(1, 2)) / self.count)
        bounded = np.where(sight.behind, 1e3, rms)
        weight = 1.0 / (s * np.sqrt(1.0 + (bounded / (_CAUCHY * s)) ** 2))[:, None, None]
        r, H_x, H_f = sight.r * weight, sight.H_x * weight[..., None], sight.H_f * weight[..., None]
        cost += float(np.sum(self.count * _CAUCHY**2 * np.log1p((bounded / (_CAUCHY * s)) ** 2)))

        by_view = np.swapaxes(H_x, 0, 1).reshape(V, 2 * F, 6)
        N_x = np.swapaxes(by_view, -1, -2) @ by_view
        b_x = (np.swapaxes(by_view, -1, -2) @ np.swapaxes(r, 0, 1).reshape(V, 2 * F, 1))[..., 0]
        C = V // K  # views of a pose are side by side
        blocks = np.zeros((K, 6, K, 6))
        blocks[np.arange(K), :, np.arange(K)] = N_x.reshape(K, C, 6, 6).sum(axis=1)
        N[np.ix_(self._poses, self._poses)] += blocks.reshape(6 * K, 6 * K)
        b[self._poses] += b_x.reshape(K, C, 6).sum(axis=1).ravel()
        N_fx = (np.swapaxes(H_f, -1, -2) @ H_x).reshape(F, K, C, 3, 6).sum(axis=2)
        N_fx = np.swapaxes(N_fx, 1, 2).reshape(F, 3, 6 * K)
        N_f, b_f, unlikely = self._of_the_points(points, H_f, r, 1.0)
        return _Normal(N, b, N_fx, N_f, b_f, cost + unlikely, np.where(sight.behind, np.inf, rms))

    def _of_the_path(self, path: Path) -> tuple[Floats, Floats, float]:
        """What was known beforehand and what the IMU says."""
        K = len(path.R)
        N, b = np.zeros((9 * K + 6, 9 * K + 6)), np.zeros(9 * K + 6)
        e = self._device.vector - np.concatenate([path.b_g, path.b_a])
        N[-6:, -6:] = self._information
        b[-6:] = self._information @ e
        N[VELOCITY, VELOCITY] = np.eye(3) / _SPEED_SIGMA**2
        b[VELOCITY] = -path.v[0] / _SPEED_SIGMA**2
        r, H = self._inertia.residuals(path)
        H_T = np.swapaxes(H, -1, -2)
        N_k, b_k = H_T @ H, (H_T @ r[..., None])[..., 0]
        for k in range(K - 1):
            i = np.r_[9 * k : 9 * k + 18, 9 * K : 9 * K + 6]
            N[np.ix_(i, i)] += N_k[k]
            b[i] += b_k[k]
        cost = e @ self._information @ e + path.v[0] @ path.v[0] / _SPEED_SIGMA**2 + np.sum(r * r)
        return N, b, float(cost)

    def _of_the_points(self, points: Points, H_f: Floats, r: Floats, noise: float) -> tuple[Floats, Floats, float]:
        """Normal equations of the points alone, from rows whose noise is `noise`, and how unlikely their ranges are."""
        F = len(r)
        H, residuals = H_f.reshape(F, -1, 3), r.reshape(F, -1, 1)
        H_T = np.swapaxes(H, -1, -2)
        N_f, b_f = H_T @ H, (H_T @ residuals)[..., 0]
        e, w = points.range_residual, (noise / points.INVERSE_RANGE_SIGMA) ** 2
        N_f[:, 2, 2] += w
        b_f[:, 2] += w * e
        N_f += 1e-6 * np.eye(3)
        return N_f, b_f, float(e @ e) * w

    def fitted(self, path: Path, points: Points) -> Points:
        """The points after a Gauss-Newton step of their own: a path that was stretched needs them stretched, too."""
        sight = Sight.of(self.views, path.R, path.p, points, by_poses=False)
        N_f, b_f, _ = self._of_the_points(points, sight.H_f, sight.r, self.pixel_noise)
        return points.moved(np.asarray(np.linalg.solve(N_f, b_f[..., None])[..., 0]), points.origin)

    def step(self, normal: _Normal, path: Path, damping: float) -> tuple[Floats, Floats]:
        """Levenberg-Marquardt's step of path (n,) and points (F, 3)."""
        N, b, whiten, G, c = self._without_points(normal, path, damping)
        N[np.diag_indices_from(N)] *= 1.0 + damping
        scale = 1.0 / np.sqrt(np.diagonal(N))
        dx = np.zeros(len(normal.b))
        dx[self._free] = scale * cho_solve(cho_factor(N * scale[:, None] * scale, lower=True), scale * b)
        dx[self._last] = path.R[-1].T @ dx[self._last]
        left = c - G @ dx[self._poses]
        df: Floats = (np.swapaxes(whiten, -1, -2) @ left[..., None])[..., 0]
        return dx, df

    def covariance(self, normal: _Normal, path: Path) -> Floats:
        """(n, n) of the path."""
        N = self._without_points(normal, path, 0.0)[0]
        scale = 1.0 / np.sqrt(np.diagonal(N))
        P = np.zeros((len(normal.b), len(normal.b)))
        P[np.ix_(self._free, self._free)] = np.linalg.inv(N * scale[:, None] * scale) * scale[:, None] * scale
        P[self._last] = path.R[-1].T @ P[self._last]
        P[:, self._last] = P[:, self._last] @ path.R[-1]
        return P

    def _without_points(
        self, normal: _Normal, path: Path, damping: float
    ) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Points and gauge eliminated: N, b of what is free, and L^-1 (F, 3, 3), L^-1 N_fx, L^-1 b_f with N_f = L L^T.

        The last pose turns about the axes of W here, so that its yaw is a column that can be left out.
        """
        whiten = np.linalg.inv(np.linalg.cholesky(normal.N_f * (1.0 + damping * np.eye(3))))
        G, c = whiten @ normal.N_fx, (whiten @ normal.b_f[..., None])[..., 0]
        flat = G.reshape(-1, G.shape[-1])
        N, b, R = normal.N.copy(), normal.b.copy(), path.R[-1]
        N[np.ix_(self._poses, self._poses)] -= flat.T @ flat
        b[self._poses] -= flat.T @ c.ravel()
        N[self._last] = R @ N[self._last]
        N[:, self._last] = N[:, self._last] @ R.T
        b[self._last] = R @ b[self._last]
        return N[np.ix_(self._free, self._free)], b[self._free], whiten, G, c


def refine(window: Window, path: Path, pixel_noise: float) -> Refined | str:
    """Refine a window from a path, in two rounds; a few words why not if it fails.

    After the first, features that do not fit go, and the pixel noise is what the others show: never more than
    `pixel_noise` unless their scatter itself is.
    """
    inertia = Inertia.of(window)
    problem = _Problem(window, window.views, inertia, pixel_noise)
    first = _settled(problem, path, Points.triangulated(window.views, path.R, path.p))
    if isinstance(first, str):
        return first
    path, points, normal = first
    keep = normal.rms < _GATE * pixel_noise
    if keep.sum() < _LEAST_FEATURES:
        return "features do not fit one motion"
    views = window.views.rows(keep)
    shown = _shown_noise(normal.rms[keep], problem.count[keep])
    noise = max(min(_CORRELATION * shown, pixel_noise), shown, _LEAST_NOISE)
    problem = _Problem(window, views, inertia, noise)
    second = _settled(problem, path, points.rows(keep))
    if isinstance(second, str):
        return second
    path, points, final = second
    dof = max(2.0 * views.seen.sum() - 3.0 * len(views.seen) - 5.0, 1.0)
    return Refined(path, points, problem.covariance(final, path), normal.cost, dof, noise)


def _shown_noise(rms: Floats, count: Floats) -> float:
    """Pixel noise, per axis, behind the rms errors (F,) of features with so many views: the middle one's."""
    return float(np.median(rms / np.sqrt(2.0 - 3.0 / count)))


def _settled(problem: _Problem, path: Path, points: Points) -> tuple[Path, Points, _Normal] | str:
    """Levenberg-Marquardt until the cost does not change any more."""
    normal, damping = problem.linearise(path, points), _DAMPING[0]
    for _ in range(_STEPS):
        try:
            dx, df = problem.step(normal, path, damping)
        except np.linalg.LinAlgError:
            return "motion does not determine the state"
        trial = path.moved(dx)
        if not np.isfinite(dx).all() or np.abs(trial.v).max() > _MAX_SPEED:
            return "refinement runs away"
        moved = points.moved(df, last_origins(problem.views, trial.R, trial.p))
        moved = problem.fitted(trial, moved)
        new = problem.linearise(trial, moved)
        gain = normal.cost - new.cost
        if gain >= 0.0:
            path, points, normal, damping = trial, moved, new, max(0.03 * damping, _DAMPING[1])
        else:
            damping *= 10.0
        if abs(gain) < _SETTLED[0] + _SETTLED[1] * normal.cost:
            return path, points, normal
    return "refinement does not settle"

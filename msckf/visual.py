"""The measurement of features over the window of clones (docs/filter.md, section 4)."""

from dataclasses import dataclass, replace

import numpy as np

from msckf.config import VisionConfig
from msckf.estimated import Estimated
from msckf.triangulation import Triangulated, triangulate
from msckf.views import Rig, Views
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps, Vectors
from navcore.chi_square import chi_square_quantile

_FLOOR = 1e-13  # of a normal matrix with a unit diagonal


@dataclass(frozen=True)
class VisualMeasurement:
    """What F features seen from K clones say about the clones, and about themselves.

    Attributes:
        H, r: (m, n), (m,) px: a measurement of the clones, after the extrinsics if those are estimated, free of the
            features, with white noise of `pixel_noise`.
        used: (F,) features behind it.
        rejected: (F,) features that no position explains, or that the chi-square test refused.
        nis, dof: (T,) normalised innovation squared of the features that were tested, and its degrees of freedom.
        points, p_linear, parts: of the features used: where they are, where they were linearised (U, 3), how each
            determines its own position.
    """

    H: Floats
    r: Floats
    used: Mask
    rejected: Mask
    nis: Floats
    dof: Floats
    points: Triangulated
    p_linear: Vectors
    parts: "Split"


@dataclass(frozen=True)
class VisualOutcome:
    """What vision did to the state.

    Attributes:
        used, rejected: features.
        nis, dof: (N,) of the features that were tested.
    """

    used: int = 0
    rejected: int = 0
    nis: Floats | None = None
    dof: Floats | None = None


def linearise(
    views: Views,
    R_WB: Rotations,
    p_WB: Vectors,
    R_lin: Rotations,
    p_lin: Vectors,
    features: Vectors,
) -> tuple[Floats, Floats, Floats, Vectors]:
    """Residuals and Jacobians of every view.

    Residuals are taken at the current poses R_WB (K, 3, 3), p_WB (K, 3) and features (F, 3); Jacobians at R_lin,
    p_lin, with each feature moved along with its last view, so that the geometry of the linearisation is that of
    the estimate however far the window has shifted since.

    Returns:
        r (F, V, 2), H_x (F, V, 2, 6) by (dtheta, dp) of the clone that saw it, H_f (F, V, 2, 3), zero where not seen;
        and where the features were linearised, (F, 3).
    """
    rig, weight = views.rig, views.seen.astype(np.float64)[..., None]
    last = views.poses[views.last]
    in_last = np.swapaxes(R_WB[last], -1, -2) @ (features - p_WB[last])[..., None]
    moved = p_lin[last] + (R_lin[last] @ in_last)[..., 0]
    both = np.stack([R_WB, R_lin]), np.stack([p_WB, p_lin]), np.stack([features, moved])
    p_BF, p_CF = _in_camera(views, *both)
    uv, J = rig.project_jacobian(views.cameras, p_CF)
    r = (views.uv - uv[0]) * weight
    R_CB = np.swapaxes(rig.R_BC, -1, -2)[views.cameras]  # (V, 3, 3)
    J_B = (J[1] * weight[..., None]) @ R_CB
    H_f = J_B @ np.swapaxes(R_lin, -1, -2)[views.poses]
    H_x = np.concatenate([J_B @ so3.hat(p_BF[1]), -H_f], axis=-1)
    return r, H_x, H_f, moved


def by_calibration(
    views: Views, H_f: Floats, R_lin: Rotations, p_lin: Vectors, p_linear: Vectors, estimated: Estimated
) -> Floats:
    """(F, 2 V, n C) derivatives of the pixels by what is estimated of the cameras, n for each.

    With J_B = H_f R_WB and y = p_BF - p_BC: d uv / d dtheta_BC = J_B [y]x R_BC, d uv / d dp_BC = -J_B.
    H_f is (F, V, 2, 3).
    """
    F, V = H_f.shape[:2]
    C, n = len(views.rig), estimated.camera_size
    H = np.zeros((F, V, 2, C, n))
    if n == 0:
        return H.reshape(F, 2 * V, 0)
    p_BF, p_CF = _in_camera(views, R_lin, p_lin, p_linear)
    own = camera_jacobian(views.rig, views.cameras, H_f @ R_lin[views.poses], p_BF, p_CF, estimated)
    own = own * views.seen[..., None, None]
    H[:, np.arange(V), :, views.cameras] = np.swapaxes(own, 0, 1)
    return H.reshape(F, 2 * V, C * n)


def camera_jacobian(
    rig: Rig, cameras: Stamps, J_B: Floats, p_BF: Vectors, p_CF: Vectors, estimated: Estimated
) -> Floats:
    """(..., N, 2, n) derivatives of pixels by what is estimated of the camera that each goes through.

    Args:
        rig: the cameras; cameras: (N,) which one.
        J_B: (..., N, 2, 3) derivative of the pixel by the point in B.
        p_BF, p_CF: (..., N, 3) the point in B and in C.
        estimated: what is.
    """
    parts = []
    if estimated.extrinsics:
        y = p_BF - rig.p_BC[cameras]
        parts += [J_B @ so3.hat(y) @ rig.R_BC[cameras], -J_B]
    if estimated.intrinsics:
        parts.append(rig.by_intrinsics(cameras, p_CF))
    return np.concatenate(parts, axis=-1)


def _in_camera(views: Views, R_WB: Rotations, p_WB: Vectors, features: Vectors) -> tuple[Vectors, Vectors]:
    """Features (..., F, 3) in the body frame and the camera frame of every view, (..., F, V, 3) each.

    For poses R_WB (..., K, 3, 3), p_WB (..., K, 3).
    """
    rig = views.rig
    R_BW = np.swapaxes(R_WB, -1, -2)[..., None, views.poses, :, :]
    p_BF = (R_BW @ (features[..., None, :] - p_WB[..., None, views.poses, :])[..., None])[..., 0]
    R_CB = np.swapaxes(rig.R_BC, -1, -2)[views.cameras]
    return p_BF, (R_CB @ (p_BF - rig.p_BC[views.cameras])[..., None])[..., 0]


@dataclass(frozen=True)
class Split:
    """Observations of F features, split into what their positions can explain and what they cannot.

    Attributes:
        r: (F, 2 V), H: (F, 2 V, 6 K): what no position explains.
        r_1: (F, 3), H_1: (F, 3, 6 K), R_1: (F, 3, 3): r_1 = H_1 dx + R_1 dp + noise, which determines the position.
    """

    r: Floats
    H: Floats
    r_1: Floats
    H_1: Floats
    R_1: Floats

    def rows(self, mask: Mask) -> "Split":
        """Only some of the features."""
        return Split(self.r[mask], self.H[mask], self.r_1[mask], self.H_1[mask], self.R_1[mask])


def split(views: Views, r: Floats, H_x: Floats, H_f: Floats, H_c: Floats) -> Split:
    """Separate what the features' positions can explain from what they cannot.

    With H_f = Q_1 R_1 (reduced QR), I - Q_1 Q_1^T projects onto the left null space of H_f. Least squares and the
    chi-square test see the projection as they see a basis of that space (Mourikis and Roumeliotis 2007, eq. 24):
    it is symmetric and idempotent, and the rows that become redundant carry neither signal nor residual.

    Args:
        views: what was seen.
        r: (F, V, 2), H_x: (F, V, 2, 6), H_f: (F, V, 2, 3), zero where not seen.
        H_c: (F, 2 V, n) by other states, whose columns come before those of the poses.
    """
    F, V = r.shape[:2]
    by_pose = np.zeros((F, V, 2, views.count, 6))
    by_pose[:, np.arange(V), :, views.poses] = np.swapaxes(H_x, 0, 1)
    rows = [H_c, by_pose.reshape(F, 2 * V, 6 * views.count), r.reshape(F, 2 * V, 1)]
    H_r = np.concatenate(rows, axis=-1)
    Q_1, R_1 = np.linalg.qr(H_f.reshape(F, 2 * V, 3))
    own = np.swapaxes(Q_1, -1, -2) @ H_r
    rest = H_r - Q_1 @ own
    return Split(rest[..., -1], rest[..., :-1], own[..., -1], own[..., :-1], R_1)


def normalised_innovations(r: Floats, H: Floats, P: Floats, pixel_noise: float) -> Floats:
    """r^T (H P H^T + s^2 I)^-1 r for every feature: (F, m), (F, m, n), (n, n) to (F,)."""
    S = H @ P @ np.swapaxes(H, -1, -2)
    m = np.arange(S.shape[1])
    S[:, m, m] += pixel_noise**2
    return np.asarray(np.einsum("fi,fi->f", r, np.linalg.solve(S, r[..., None])[..., 0]))


def compress(r: Floats, H: Floats) -> tuple[Floats, Floats]:
    """The same information in at most as many rows as columns: (m,), (m, n) to (min(m, n),), (min(m, n), n).

    By the Cholesky factor of (H, r)^T (H, r), after the columns are scaled to length one, which costs a fifth of a QR.
    It loses the singular values of H below 1e-8 of the largest, and `_FLOOR` puts a little in their place, where the
    pixels say nothing: about 2e-3 px/m, which over ten minutes knows a position to 30 m (docs/filter.md, section 4.7).
    """
    m, n = H.shape
    if m <= n:
        return r, H
    H_r = np.column_stack([H, r])
    A = H_r.T @ H_r
    length = np.sqrt(np.diagonal(A)) + 1e-9
    A /= length[:, None] * length
    A.flat[:: n + 2] += _FLOOR
    L = np.linalg.cholesky(A) * length[:, None]
    return L[n, :n], L[:n, :n].T


def measure(
    views: Views,
    R_WB: Rotations,
    p_WB: Vectors,
    R_lin: Rotations,
    p_lin: Vectors,
    P: Floats,
    config: VisionConfig,
    estimated: Estimated,
    moved: Floats | None = None,
) -> VisualMeasurement:
    """Everything that F features seen from K clones say about the clones, gated and compressed.

    Args:
        views: what was seen.
        R_WB, p_WB: clone poses; R_lin, p_lin: where to linearise.
        P: (n, n) covariance of the clones, after that of what is estimated of the cameras.
        config: noise, limits and gate.
        estimated: what that is.
        moved: (n,) error state by which the poses given differ from those that `P` is about; the measurement is of
            the latter, and any reprojection error is believed until the test.
    """
    points = triangulate(views, R_WB, p_WB, config)
    sane = points.valid & ((points.rms < 10.0 * config.pixel_noise) | (moved is not None))
    misfit = points.valid & ~sane
    views, points = views.rows(sane), points.rows(sane)
    r, H_x, H_f, p_linear = linearise(views, R_WB, p_WB, R_lin, p_lin, points.p_WF)
    parts = split(views, r, H_x, H_f, by_calibration(views, H_f, R_lin, p_lin, p_linear, estimated))
    if moved is not None:
        parts = replace(parts, r=parts.r + parts.H @ moved, r_1=parts.r_1 + parts.H_1 @ moved)
    nis = normalised_innovations(parts.r, parts.H, P, config.pixel_noise)
    dof = 2.0 * views.seen.sum(axis=1) - 3.0
    passed = nis <= chi_square_quantile(config.gate_probability, dof)
    r_all, H_all = compress(parts.r[passed].ravel(), parts.H[passed].reshape(-1, parts.H.shape[-1]))
    used, rejected = sane.copy(), misfit
    used[sane], rejected[sane] = passed, ~passed
    return VisualMeasurement(
        H_all, r_all, used, rejected, nis, dof, points.rows(passed), p_linear[passed], parts.rows(passed)
    )

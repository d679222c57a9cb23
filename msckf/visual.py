"""The measurement of features over the window of clones (docs/filter.md, section 4)."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from msckf.config import VisionConfig
from msckf.triangulation import Triangulated, triangulate
from msckf.views import Views
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Vectors


@dataclass(frozen=True)
class VisualMeasurement:
    """A linear measurement of the clones, free of the features, with white noise of `pixel_noise`.

    Attributes:
        H: (m, 6 K) by the clones' error states.
        r: (m,) px.
        used: (F,) features behind it.
        rejected: (F,) features that the chi-square test refused.
        nis: (F,) normalised innovation squared; meaningless where neither used nor rejected.
        dof: (F,) its degrees of freedom.
    """

    H: Floats
    r: Floats
    used: Mask
    rejected: Mask
    nis: Floats
    dof: Floats


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
    *,
    follow: bool = True,
) -> tuple[Floats, Floats, Floats]:
    """Residuals and Jacobians of every view.

    Residuals are taken at the current poses R_WB (K, 3, 3), p_WB (K, 3) and features (F, 3); Jacobians at R_lin,
    p_lin, with each feature moved along with its last view (unless `follow` is off), so that the geometry of the
    linearisation is that of the estimate however far the window has shifted since.

    Returns:
        r (F, K, 2), H_x (F, K, 2, 6) by (dtheta, dp) of the clone that saw it, H_f (F, K, 2, 3); zero where not seen.
    """
    rig, cameras = views.rig, views.cameras
    weight = views.seen.astype(np.float64)[..., None]
    uv, _ = rig.project_jacobian(cameras, _in_camera(views, R_WB, p_WB, features))
    r = (views.uv - uv) * weight

    last = views.seen.shape[1] - 1 - np.argmax(views.seen[:, ::-1], axis=1)
    in_last = np.swapaxes(R_WB[last], -1, -2) @ (features - p_WB[last])[..., None]
    moved = p_lin[last] + (R_lin[last] @ in_last)[..., 0] if follow else features
    _, J = rig.project_jacobian(cameras, _in_camera(views, R_lin, p_lin, moved))
    J = J * weight[..., None]
    R_CB = np.swapaxes(rig.R_BC, -1, -2)[cameras][:, None]  # (F, 1, 3, 3)
    R_BW = np.swapaxes(R_lin, -1, -2)[None]  # (1, K, 3, 3)
    p_BF = (R_BW @ (moved[:, None] - p_lin)[..., None])[..., 0]
    H_f = J @ (R_CB @ R_BW)
    H_x = np.concatenate([J @ R_CB @ so3.hat(p_BF), -H_f], axis=-1)
    return r, H_x, H_f


def _in_camera(views: Views, R_WB: Rotations, p_WB: Vectors, features: Vectors) -> Vectors:
    """Features (F, 3) in the camera frame of every view, (F, K, 3)."""
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    return (np.swapaxes(R_WC, -1, -2) @ (features[:, None] - p_WC)[..., None])[..., 0]


@dataclass(frozen=True)
class Split:
    """Observations of F features, split into what their positions can explain and what they cannot.

    Attributes:
        r: (F, 2 K), H: (F, 2 K, 6 K): what no position explains.
        r_1: (F, 3), H_1: (F, 3, 6 K), R_1: (F, 3, 3): r_1 = H_1 dx + R_1 dp + noise, which determines the position.
    """

    r: Floats
    H: Floats
    r_1: Floats
    H_1: Floats
    R_1: Floats


def split(r: Floats, H_x: Floats, H_f: Floats) -> Split:
    """Separate what the features' positions can explain from what they cannot.

    With H_f = Q_1 R_1 (reduced QR), I - Q_1 Q_1^T projects onto the left null space of H_f. Least squares and the
    chi-square test see the projection as they see a basis of that space (Mourikis and Roumeliotis 2007, eq. 24):
    it is symmetric and idempotent, and the rows that become redundant carry neither signal nor residual.

    Args:
        r: (F, K, 2), H_x: (F, K, 2, 6), H_f: (F, K, 2, 3), zero where not seen.
    """
    F, K = r.shape[:2]
    blocks = np.zeros((F, K, 2, K, 6))
    k = np.arange(K)
    blocks[:, k, :, k] = np.swapaxes(H_x, 0, 1)
    H, r = blocks.reshape(F, 2 * K, 6 * K), r.reshape(F, 2 * K)
    Q_1, R_1 = np.linalg.qr(H_f.reshape(F, 2 * K, 3))
    Q_t = np.swapaxes(Q_1, -1, -2)
    r_1, H_1 = (Q_t @ r[..., None])[..., 0], Q_t @ H
    return Split(r - (Q_1 @ r_1[..., None])[..., 0], H - Q_1 @ H_1, r_1, H_1, R_1)


def project_out(r: Floats, H_x: Floats, H_f: Floats) -> tuple[Floats, Floats]:
    """r (F, 2 K) and H (F, 2 K, 6 K) free of the features' positions; arguments as `split`."""
    parts = split(r, H_x, H_f)
    return parts.r, parts.H


def normalised_innovations(r: Floats, H: Floats, P: Floats, pixel_noise: float) -> Floats:
    """r^T (H P H^T + s^2 I)^-1 r for every feature: (F, m), (F, m, n), (n, n) to (F,)."""
    S = H @ P @ np.swapaxes(H, -1, -2)
    m = np.arange(S.shape[1])
    S[:, m, m] += pixel_noise**2
    return np.asarray(np.einsum("fi,fi->f", r, np.linalg.solve(S, r[..., None])[..., 0]))


def chi_square_quantile(probability: float, dof: Floats | float) -> Floats:
    """The value that a chi-square variable stays below with this probability."""
    return np.asarray(2.0 * gammaincinv(np.asarray(dof) / 2.0, probability))


def compress(r: Floats, H: Floats) -> tuple[Floats, Floats]:
    """The same information in at most as many rows as columns (thin QR): (m,), (m, n) to (min(m, n),), (..., n)."""
    if H.shape[0] <= H.shape[1]:
        return r, H
    stacked: Floats = np.linalg.qr(np.column_stack([H, r]), mode="r")  # type: ignore[assignment]
    n = H.shape[1]
    return stacked[:n, n], stacked[:n, :n]


def measure(
    views: Views,
    R_WB: Rotations,
    p_WB: Vectors,
    R_lin: Rotations,
    p_lin: Vectors,
    P: Floats,
    config: VisionConfig,
) -> VisualMeasurement | None:
    """Everything that F features seen from K clones say about the clones, gated and compressed.

    Args:
        views: what was seen.
        R_WB, p_WB: clone poses; R_lin, p_lin: where to linearise.
        P: (6 K, 6 K) covariance of the clones.
        config: noise, limits and gate.

    Returns:
        None if no feature passed.
    """
    if len(views.uv) == 0:
        return None
    points: Triangulated = triangulate(views, R_WB, p_WB, config)
    sane = points.valid & (points.rms < 10.0 * config.pixel_noise)
    if not sane.any():
        return None
    kept = views.rows(sane)
    r, H_x, H_f = linearise(kept, R_WB, p_WB, R_lin, p_lin, points.p_WF[sane])
    r, H = project_out(r, H_x, H_f)
    sane_nis = normalised_innovations(r, H, P, config.pixel_noise)
    sane_dof = 2.0 * kept.seen.sum(axis=1) - 3.0
    passed = sane_nis <= chi_square_quantile(config.gate_probability, sane_dof)

    nis, dof = np.zeros(len(sane)), np.ones(len(sane))
    nis[sane], dof[sane] = sane_nis, sane_dof
    used, rejected = np.zeros(len(sane), dtype=bool), np.zeros(len(sane), dtype=bool)
    used[sane], rejected[sane] = passed, ~passed
    n = H.shape[-1]
    if passed.any():
        r_all, H_all = compress(r[passed].ravel(), H[passed].reshape(-1, n))
    else:
        r_all, H_all = np.zeros(0), np.zeros((0, n))
    return VisualMeasurement(H_all, r_all, used, rejected, nis, dof)

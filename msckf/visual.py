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
    """What F features seen from K clones say about the clones, and about themselves.

    Attributes:
        H, r: (m, n), (m,) px: a measurement of the clones, after the extrinsics if those are estimated, free of the
            features, with white noise of `pixel_noise`.
        used: (F,) features behind it.
        rejected: (F,) features that the chi-square test refused.
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
        r (F, K, 2), H_x (F, K, 2, 6) by (dtheta, dp) of the clone that saw it, H_f (F, K, 2, 3), zero where not seen;
        and where the features were linearised, (F, 3).
    """
    rig, cameras = views.rig, views.cameras
    weight = views.seen.astype(np.float64)[..., None]
    uv, _ = rig.project_jacobian(cameras, _in_camera(views, R_WB, p_WB, features))
    r = (views.uv - uv) * weight

    last = views.seen.shape[1] - 1 - np.argmax(views.seen[:, ::-1], axis=1)
    in_last = np.swapaxes(R_WB[last], -1, -2) @ (features - p_WB[last])[..., None]
    moved = p_lin[last] + (R_lin[last] @ in_last)[..., 0]
    _, J = rig.project_jacobian(cameras, _in_camera(views, R_lin, p_lin, moved))
    J = J * weight[..., None]
    R_CB = np.swapaxes(rig.R_BC, -1, -2)[cameras][:, None]  # (F, 1, 3, 3)
    R_BW = np.swapaxes(R_lin, -1, -2)[None]  # (1, K, 3, 3)
    p_BF = (R_BW @ (moved[:, None] - p_lin)[..., None])[..., 0]
    H_f = J @ (R_CB @ R_BW)
    H_x = np.concatenate([J @ R_CB @ so3.hat(p_BF), -H_f], axis=-1)
    return r, H_x, H_f, moved


def by_extrinsics(views: Views, H_f: Floats, R_lin: Rotations, p_lin: Vectors, p_linear: Vectors) -> Floats:
    """(F, 2 K, 6 C) derivatives of the pixels by where the cameras sit, from those by the features, H_f (F, K, 2, 3).

    With J_B = H_f R_WB and y = p_BF - p_BC: d uv / d dtheta_BC = J_B [y]x R_BC, d uv / d dp_BC = -J_B.
    """
    rig, cameras = views.rig, views.cameras
    F, K = H_f.shape[:2]
    J_B = H_f @ R_lin
    p_BF = (np.swapaxes(R_lin, -1, -2) @ (p_linear[:, None] - p_lin)[..., None])[..., 0]
    y = p_BF - rig.p_BC[cameras][:, None]
    H = np.zeros((F, K, 2, len(rig.mounts), 6))
    own = np.concatenate([J_B @ so3.hat(y) @ rig.R_BC[cameras][:, None], -J_B], axis=-1)
    H[np.arange(F), :, :, cameras] = own
    return H.reshape(F, 2 * K, -1)


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

    def rows(self, mask: Mask) -> "Split":
        """Only some of the features."""
        return Split(self.r[mask], self.H[mask], self.r_1[mask], self.H_1[mask], self.R_1[mask])


def split(r: Floats, H_x: Floats, H_f: Floats, H_e: Floats | None = None) -> Split:
    """Separate what the features' positions can explain from what they cannot.

    With H_f = Q_1 R_1 (reduced QR), I - Q_1 Q_1^T projects onto the left null space of H_f. Least squares and the
    chi-square test see the projection as they see a basis of that space (Mourikis and Roumeliotis 2007, eq. 24):
    it is symmetric and idempotent, and the rows that become redundant carry neither signal nor residual.

    Args:
        r: (F, K, 2), H_x: (F, K, 2, 6), H_f: (F, K, 2, 3), zero where not seen.
        H_e: (F, 2 K, e) by other states, whose columns come before those of the poses.
    """
    F, K = r.shape[:2]
    blocks = np.zeros((F, K, 2, K, 6))
    k = np.arange(K)
    blocks[:, k, :, k] = np.swapaxes(H_x, 0, 1)
    H, r = blocks.reshape(F, 2 * K, 6 * K), r.reshape(F, 2 * K)
    if H_e is not None:
        H = np.concatenate([H_e, H], axis=-1)
    Q_1, R_1 = np.linalg.qr(H_f.reshape(F, 2 * K, 3))
    Q_t = np.swapaxes(Q_1, -1, -2)
    r_1, H_1 = (Q_t @ r[..., None])[..., 0], Q_t @ H
    return Split(r - (Q_1 @ r_1[..., None])[..., 0], H - Q_1 @ H_1, r_1, H_1, R_1)


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
    *,
    extrinsics: bool = False,
) -> VisualMeasurement | None:
    """Everything that F features seen from K clones say about the clones, gated and compressed.

    Args:
        views: what was seen.
        R_WB, p_WB: clone poses; R_lin, p_lin: where to linearise.
        P: (n, n) covariance of the clones, after that of the extrinsics if those are estimated.
        config: noise, limits and gate.
        extrinsics: whether they are estimated.

    Returns:
        None if no feature passed.
    """
    if len(views.uv) == 0:
        return None
    points = triangulate(views, R_WB, p_WB, config)
    sane = points.valid & (points.rms < 10.0 * config.pixel_noise)
    if not sane.any():
        return None
    views, points = views.rows(sane), points.rows(sane)
    r, H_x, H_f, p_linear = linearise(views, R_WB, p_WB, R_lin, p_lin, points.p_WF)
    parts = split(r, H_x, H_f, by_extrinsics(views, H_f, R_lin, p_lin, p_linear) if extrinsics else None)
    nis = normalised_innovations(parts.r, parts.H, P, config.pixel_noise)
    dof = 2.0 * views.seen.sum(axis=1) - 3.0
    passed = nis <= chi_square_quantile(config.gate_probability, dof)
    r_all, H_all = compress(parts.r[passed].ravel(), parts.H[passed].reshape(-1, parts.H.shape[-1]))
    used, rejected = sane.copy(), sane.copy()
    used[sane], rejected[sane] = passed, ~passed
    return VisualMeasurement(
        H_all, r_all, used, rejected, nis, dof, points.rows(passed), p_linear[passed], parts.rows(passed)
    )

"""Landmarks: features that live longer than the window and become part of the state (docs/filter.md, section 4)."""

import numpy as np

from msckf.config import VisionConfig
from msckf.frontend import Observations
from msckf.state import FilterState
from msckf.views import Rig
from msckf.visual import VisualMeasurement, VisualOutcome, chi_square_quantile
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps, Vectors


def promotable(state: FilterState, measurement: VisualMeasurement, config: VisionConfig) -> Mask:
    """(U,) features behind a measurement whose position is known well enough to be kept.

    A landmark keeps its linearisation point. Where the window has been corrected by more than a small part of the
    feature's distance since its poses were first estimated, that point would be a bad one for all poses to come.
    """
    clones = state.clones
    points = measurement.points
    distance = np.linalg.norm(points.p_WF - clones.p_WB[-1], axis=1)
    shift = np.linalg.norm(measurement.p_linear - points.p_WF, axis=1)
    close = shift < config.max_landmark_shift * distance
    certain = points.certainty > config.landmark_parallax
    return np.asarray(certain & (points.rms < 3.0 * config.pixel_noise) & close)


def add_landmarks(
    state: FilterState, keys: Stamps, measurement: VisualMeasurement, rows: Mask, config: VisionConfig
) -> None:
    """Make landmarks of the features `rows` (U,) behind a measurement that is yet to be applied.

    r_1 = H_1 dx + R_1 dp + n determines a position: dp = R_1^-1 (r_1 - H_1 dx - n). What the position cannot explain
    is in the measurement itself (delayed initialisation: Li and Mourikis 2012, "Optimization-based estimator design for
    vision-aided inertial navigation", section IV).
    """
    parts = measurement.parts.rows(rows)
    n = len(parts.r_1)
    R_1_inverse = np.linalg.inv(parts.R_1)
    step = (R_1_inverse @ parts.r_1[..., None])[..., 0]
    by_seen = -R_1_inverse @ parts.H_1  # (n, 3, m)
    covariance = np.zeros((n, 3, n, 3))
    own = R_1_inverse @ np.swapaxes(R_1_inverse, -1, -2) * config.pixel_noise**2
    covariance[np.arange(n), :, np.arange(n)] = own
    state.add_landmarks(
        keys,
        measurement.points.p_WF[rows] + step,
        measurement.p_linear[rows],
        by_seen.reshape(3 * n, -1),
        covariance.reshape(3 * n, 3 * n),
    )


def update_landmarks(state: FilterState, rig: Rig, observations: Observations, config: VisionConfig) -> VisualOutcome:
    """Drop the landmarks that the newest clone did not see, correct the state by the others."""
    seen, where = _match(state.landmarks.keys, observations.keys)
    state.drop_landmarks(~seen)
    n = len(state.landmarks)
    if n == 0:
        return VisualOutcome()
    k = len(state.clones) - 1
    where = where[seen]
    cameras, uv = observations.cameras[where], observations.uv[where]
    r, H, p_CF = _predict(state, rig, k, cameras, uv)
    clone = np.arange(state.clone(k).start, state.clone(k).stop)
    shared = np.r_[state.extrinsics, clone]
    landmark = state.landmark_columns(np.arange(n)).reshape(n, 3)
    columns = np.concatenate([np.tile(shared, (n, 1)), landmark], axis=1)  # (n, 6 C + 9)
    P_each = state.covariance[columns[:, :, None], columns[:, None, :]]
    S = H @ P_each @ np.swapaxes(H, -1, -2) + config.pixel_noise**2 * np.eye(2)
    nis = np.einsum("fi,fi->f", r, np.linalg.solve(S, r[..., None])[..., 0])
    passed = (nis <= chi_square_quantile(config.gate_probability, 2.0)) & (p_CF[:, 2] > config.min_depth)
    good = np.flatnonzero(passed)
    if len(good):
        m = len(good)
        s = len(shared)
        H_all = np.zeros((2 * m, s + 3 * m))
        H_all[:, :s] = H[good, :, :s].reshape(-1, s)
        block = H_all[:, s:].reshape(m, 2, m, 3)
        block[np.arange(m), :, np.arange(m)] = H[good, :, s:]
        where_all = np.concatenate([shared, state.landmark_columns(good)])
        state.update(H_all, where_all, r[good].ravel(), config.pixel_noise**2 * np.eye(2 * m))
    state.drop_landmarks(nis > chi_square_quantile(0.9999, 2.0))
    return VisualOutcome(len(good), n - len(good), nis, np.full(n, 2.0))


def _predict(state: FilterState, rig: Rig, k: int, cameras: Stamps, uv: Floats) -> tuple[Floats, Floats, Vectors]:
    """Residuals (n, 2) of all landmarks in clone `k`, H (n, 2, 6 C + 9) by extrinsics, clone, landmark; p_CF."""
    R_BC, p_BC = rig.R_BC[cameras], rig.p_BC[cameras]
    R_CB = np.swapaxes(R_BC, -1, -2)

    def from_camera(R_WB: Rotations, p_WB: Vectors, p_WF: Vectors) -> tuple[Vectors, Vectors]:
        from_camera_B = (p_WF - p_WB) @ R_WB - p_BC
        return from_camera_B, (R_CB @ from_camera_B[..., None])[..., 0]

    _, p_CF = from_camera(state.clones.R_WB[k], state.clones.p_WB[k], state.landmarks.p_WF)
    uv_hat, _ = rig.project_jacobian(cameras, p_CF[:, None])
    R_lin, p_lin = (x[k] for x in state.linearisation_clones)
    y, p_CF_lin = from_camera(R_lin, p_lin, state.linearisation_landmarks)
    _, J = rig.project_jacobian(cameras, p_CF_lin[:, None])
    J_B = J[:, 0] @ R_CB  # (n, 2, 3)
    H_f = J_B @ R_lin.T
    H = [J_B @ so3.hat(y + p_BC), -H_f, H_f]
    if state.rig is not None:
        n = len(cameras)
        H_e = np.zeros((n, 2, len(rig.mounts), 6))
        H_e[np.arange(n), :, cameras] = np.concatenate([J_B @ so3.hat(y) @ R_BC, -J_B], axis=-1)
        H.insert(0, H_e.reshape(n, 2, -1))
    return uv - uv_hat[:, 0], np.concatenate(H, axis=-1), p_CF


def _match(keys: Stamps, observed: Stamps) -> tuple[Mask, Stamps]:
    """Which of `keys` were observed, and at which index."""
    order = np.argsort(observed, kind="stable")
    at = np.minimum(np.searchsorted(observed[order], keys), max(len(observed) - 1, 0))
    if len(observed) == 0:
        return np.zeros(len(keys), dtype=bool), np.zeros(len(keys), dtype=np.int64)
    return observed[order][at] == keys, order[at]

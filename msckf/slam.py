"""Landmarks: features that live longer than the window and become part of the state (docs/filter.md, section 4.8)."""

import numpy as np

from msckf.config import VisionConfig
from msckf.landmarks import Landmarks
from msckf.state import FilterState
from msckf.visual import VisualMeasurement, VisualOutcome, camera_jacobian
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps, Vectors, among
from navcore.chi_square import chi_square_quantile
from navcore.frontend import Observations

_ENDS_BEYOND = 0.9999  # quantile of the chi-square test at which a landmark is given up


def promotable(measurement: VisualMeasurement, config: VisionConfig) -> Mask:
    """(U,) features behind a measurement whose position is known well enough to be kept."""
    points = measurement.points
    return np.asarray((points.certainty > config.landmark_parallax) & (points.rms < 3.0 * config.pixel_noise))


def add_landmarks(
    state: FilterState, keys: Stamps, cameras: Stamps, measurement: VisualMeasurement, rows: Mask, noise: float
) -> None:
    """Make landmarks, anchored in the newest clone, of features behind a measurement that is yet to be applied.

    r_1 = H_1 dx + R_1 dp + n determines a position: dp = R_1^-1 (r_1 - H_1 dx - n). What the position cannot explain
    is in the measurement itself (delayed initialisation: Li and Mourikis 2012, "Optimization-based estimator design for
    vision-aided inertial navigation", section IV). With p_WF = p_A + R_A p_AF(y), dp is by dy and by the anchor.

    Args:
        keys, cameras: (n,) of the features, and a camera of the newest clone that saw each.
        measurement: what they were found in.
        rows: (U,) which of the features behind it; all were seen from the newest clone.
        noise: px.
    """
    parts, k = measurement.parts.rows(rows), len(state.clones) - 1
    n = len(parts.r_1)
    R_1_inverse = np.linalg.inv(parts.R_1)
    p_WF = measurement.points.p_WF[rows] + (R_1_inverse @ parts.r_1[..., None])[..., 0]
    p_AF = (p_WF - state.clones.p_WB[k]) @ state.clones.R_WB[k]
    landmarks = Landmarks.at(keys, np.full(n, state.clones.t_ns[k]), state.rig.p_BC[cameras], p_AF)
    R_A, p_A = (x[k] for x in state.linearisation_clones)
    from_position = np.linalg.inv(R_A @ landmarks.by_y)  # dy = from_position (dp - by_anchor dx_A)
    by_seen = -R_1_inverse @ parts.H_1  # (n, 3, m), dp by what was seen
    by_seen[..., -6:-3] += R_A @ so3.hat((measurement.p_linear[rows] - p_A) @ R_A)  # where H_1 and R_1 were taken
    by_seen[..., -3:] -= np.eye(3)
    by_noise = from_position @ R_1_inverse * noise
    covariance = np.zeros((n, 3, n, 3))
    covariance[np.arange(n), :, np.arange(n)] = by_noise @ np.swapaxes(by_noise, -1, -2)
    state.add_landmarks(landmarks, (from_position @ by_seen).reshape(3 * n, -1), covariance.reshape(3 * n, 3 * n))


def move_anchors(state: FilterState, k: int) -> None:
    """Anchor the landmarks of clone `k`, which is to go, in the newest clone.

    p_A'F = R_A'^T (R_A p_AF + p_A - p_A'), linearised where the clones are.
    """
    leaving = state.landmarks.anchors == state.clones.t_ns[k]
    n, to = int(leaving.sum()), len(state.clones) - 1
    if n == 0:
        return
    old, clones = state.landmarks.rows(leaving), state.clones

    def moved(R: Rotations, p: Vectors) -> Vectors:
        return np.asarray((old.p_AF @ R[k].T + p[k] - p[to]) @ R[to])

    new = Landmarks.at(old.keys, np.full(n, clones.t_ns[to]), old.origins, moved(clones.R_WB, clones.p_WB))
    R, p = state.linearisation_clones
    turn = R[to].T @ R[k]
    by_point = np.concatenate(
        [
            -turn @ so3.hat(old.p_AF),
            np.tile(R[to].T, (n, 1, 1)),
            so3.hat(moved(R, p)),
            np.tile(-R[to].T, (n, 1, 1)),
            turn @ old.by_y,
        ],
        axis=-1,
    )
    poses = np.r_[state.clone(k), state.clone(to)]
    own = state.landmark_columns(np.flatnonzero(leaving)).reshape(n, 3)
    columns = np.concatenate([np.tile(poses, (n, 1)), own], axis=1)
    state.move_landmarks(leaving, new, np.linalg.inv(new.by_y) @ by_point, columns)


def update_landmarks(state: FilterState, observations: Observations, config: VisionConfig) -> VisualOutcome:
    """Correct the state by what the newest clone saw of its landmarks; drop those that it did not see.

    While a camera is blind none is dropped: it may be this camera that sees them.
    """
    seen = among(state.landmarks.keys, observations.keys)
    if not observations.blind:
        state.drop_landmarks(~seen)
    if not seen.any():
        return VisualOutcome()
    which, where = _match(state.landmarks.keys, observations.keys)
    cameras, uv = observations.cameras[where], observations.uv[where]
    r, H, columns, p_CF = _predict(state, which, cameras, uv)
    HP, S = state.seen_through(H, columns)
    N = len(which)
    S[np.diag_indices(2 * N)] += config.pixel_noise**2
    n = np.arange(N)
    S_each = S.reshape(N, 2, N, 2)[n, :, n]
    nis = np.einsum("ni,ni->n", r, np.linalg.solve(S_each, r[..., None])[..., 0])
    passed = (nis <= chi_square_quantile(config.gate_probability, 2.0)) & (p_CF > config.min_depth)
    rows = np.repeat(passed, 2)
    if passed.any():
        state.correct(HP[rows], S[rows][:, rows], r[passed].ravel())
    misfit = np.bincount(which[nis > chi_square_quantile(_ENDS_BEYOND, 2.0)], minlength=len(state.landmarks)) > 0
    state.drop_landmarks(misfit | (state.landmarks.y[:, 2] <= 1.0 / config.max_landmark_depth))
    return VisualOutcome(int(passed.sum()), int((~passed).sum()), nis, np.full(N, 2.0))


def _predict(state: FilterState, which: Stamps, cameras: Stamps, uv: Floats) -> tuple[Floats, Floats, Stamps, Floats]:
    """Views of landmarks `which` (N,) from the newest clone.

    Returns:
        Residuals (N, 2), H (N, 2, m) by the error states `columns` (N, m): those of the camera, of the anchor, of the
        newest clone and of the landmark; and depths (N,) m in the camera.
    """
    landmarks, rig, k = state.landmarks, state.rig, len(state.clones) - 1
    anchors = np.searchsorted(state.clones.t_ns, landmarks.anchors[which])
    p_AF = landmarks.p_AF[which]
    R_CB, p_BC = np.swapaxes(rig.R_BC, -1, -2)[cameras], rig.p_BC[cameras]

    R, p = state.linearisation_clones
    R_both, p_both = np.stack([state.clones.R_WB, R]), np.stack([state.clones.p_WB, p])  # (2, K, ...)
    p_WF = (R_both[:, anchors] @ p_AF[..., None])[..., 0] + p_both[:, anchors]
    p_BF = (p_WF - p_both[:, k, None]) @ R_both[:, k]  # (2, N, 3)
    p_CF = (R_CB @ (p_BF - p_BC)[..., None])[..., 0]
    (uv_hat, _), (_, J) = zip(*rig.project_jacobian(cameras, p_CF), strict=True)
    (_, p_BF_lin), (p_CF, p_CF_lin) = p_BF, p_CF
    J_B = J @ R_CB  # (N, 2, 3)
    J_W = J_B @ R[k].T
    J_A = J_W @ R[anchors]
    parts = [-J_A @ so3.hat(p_AF), J_W, J_B @ so3.hat(p_BF_lin), -J_W, J_A @ landmarks.by_y[which]]

    def block(first: Stamps, size: int) -> Stamps:
        return np.asarray(np.broadcast_to(first, len(which))[:, None] + np.arange(size))

    columns = [
        block(state.clone_start + 6 * anchors, 6),
        block(np.array(state.clone(k).start), 6),
        block(state.clone_stop + 3 * which, 3),
    ]
    size = state.estimated.camera_size
    if size:
        parts.insert(0, camera_jacobian(rig, cameras, J_B, p_BF_lin, p_CF_lin, state.estimated))
        columns.insert(0, block(state.cameras.start + size * cameras, size))
    return uv - uv_hat, np.concatenate(parts, axis=-1), np.concatenate(columns, axis=1), p_CF[:, 2]


def _match(keys: Stamps, observed: Stamps) -> tuple[Stamps, Stamps]:
    """For each observation of one of `keys` (L,): which of them, and which of `observed` (N,)."""
    order = np.argsort(keys, kind="stable")
    at = np.minimum(np.searchsorted(keys[order], observed), len(keys) - 1)
    where = np.flatnonzero(keys[order][at] == observed)
    return order[at[where]], where

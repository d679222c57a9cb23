"""The filter's state: nominal values, first estimates and covariance under one owner (docs/filter.md, section 1)."""

from copy import copy

import numpy as np
from scipy.linalg.blas import dtrsm
from scipy.sparse import csr_array

from msckf.blocks import ACCEL_BIAS, BIASES, GYRO_BIAS, IMU_SIZE, POSITION, THETA, VELOCITY
from msckf.clones import Clones
from msckf.estimated import POSE_SIZE, Estimated
from msckf.landmarks import Landmarks
from msckf.propagation import Increment, noise_in_world, predict, transition
from msckf.views import INTRINSICS_SIZE, Rig
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps, Vectors
from navcore.odometry import State

CLONE_SIZE = 6
_MOVING = np.ix_(np.r_[THETA, VELOCITY], np.r_[THETA, VELOCITY])
LANDMARK_SIZE = 3
_FAR_OFF = (0.01, 0.003, 0.01)  # rad, m/s and share of the speed, a correction after which first estimates are given up


class FilterState:
    """Nominal state and covariance, changed only together.

    Error order: `dtheta, dp, dv, db_g, db_a`, then what is estimated of the calibration (the time offset, then of each
    camera `dtheta, dp` and intrinsics), the prior's error `c` (6, if it is estimated), clones (`dtheta, dp` each),
    landmarks (3 each). With `fej` off, linearisation points follow the current estimates.

    Args:
        start: the first state.
        rig: the cameras, as far as they are known.
        dt_cam_imu: s, likewise.
        fej: whether to linearise at first estimates.
    """

    def __init__(self, start: State, rig: Rig, dt_cam_imu: float = 0.0, *, fej: bool = True) -> None:
        self.R_WB, self.p_WB, self.v_WB = start.R_WB.copy(), start.p_WB.copy(), start.v_WB.copy()
        self.b_g, self.b_a = start.b_g.copy(), start.b_a.copy()
        self.rig = rig
        self.dt_cam_imu = dt_cam_imu
        self.estimated = Estimated()
        self.c: Floats | None = None
        self.clones = Clones.none()
        self.landmarks = Landmarks.none()
        self._fej = fej
        self._P = start.covariance.copy()
        self._lay_out()
        self._keep_first_estimates()

    def _lay_out(self) -> None:
        """Where things are in the error state; a slice is empty when nothing of it is estimated."""
        cameras = IMU_SIZE + self.estimated.time_offset
        prior_error = cameras + self.estimated.camera_size * len(self.rig)
        self.clone_start = prior_error + (0 if self.c is None else 6)
        self.time_offset = slice(IMU_SIZE, cameras)  # `dt_cam_imu`
        self.cameras = slice(cameras, prior_error)  # camera by camera
        self.calibration = slice(IMU_SIZE, prior_error)  # both
        self.prior_error = slice(prior_error, self.clone_start)  # `c`

    # -- reading ----------------------------------------------------------------------------------------------

    @property
    def covariance(self) -> Floats:
        """The whole covariance, read-only."""
        view = self._P.view()
        view.setflags(write=False)
        return view

    @property
    def velocity_sigma(self) -> float:
        """m/s, the largest of an axis of R_WB^T v_WB: in the world a heading that nobody can know would count, the more
        the faster the body is and the longer it has been under way."""
        R_BW = self.R_WB.T
        J = np.hstack([so3.hat(R_BW @ self.v_WB), R_BW])  # by dtheta, dv
        variance = np.einsum("ij,jk,ik->i", J, self._P[_MOVING], J)
        return float(np.sqrt(max(variance.max(), 0.0)))

    @property
    def size(self) -> int:
        """Number of error states."""
        return len(self._P)

    @property
    def seen_columns(self) -> Stamps:
        """Error states that observations over the window depend on: cameras and clones."""
        return np.asarray(np.r_[self.cameras, self.clone_start : self.clone_stop])

    def clone(self, k: int) -> slice:
        """Where clone `k` is."""
        first = self.clone_start + CLONE_SIZE * k
        return slice(first, first + CLONE_SIZE)

    @property
    def clone_stop(self) -> int:
        """Index behind the last clone's last error state: where landmarks begin."""
        return self.clone_start + CLONE_SIZE * len(self.clones)

    def landmark_columns(self, rows: Stamps) -> Stamps:
        """Indices (3 n,) of the error states of landmarks `rows` (n,)."""
        return (self.clone_stop + LANDMARK_SIZE * rows[:, None] + np.arange(LANDMARK_SIZE)).ravel()

    @property
    def linearisation_clones(self) -> tuple[Rotations, Vectors]:
        """Poses (K, 3, 3), (K, 3) at which measurements of clones are linearised."""
        if self._fej:
            return self.clones.R_first, self.clones.p_first
        return self.clones.R_WB, self.clones.p_WB

    @property
    def biases(self) -> Floats:
        """(6,) b_g, b_a."""
        return np.concatenate([self.b_g, self.b_a])

    def snapshot(self) -> State:
        """A copy of the navigation state with its covariance."""
        P = self._P[:IMU_SIZE, :IMU_SIZE].copy()
        return State(self.R_WB.copy(), self.p_WB.copy(), self.v_WB.copy(), self.b_g.copy(), self.b_a.copy(), P)

    # -- time -------------------------------------------------------------------------------------------------

    def checkpoint(self) -> "FilterState":
        """The state as it is now, to come back to after a measurement."""
        kept = copy(self)
        kept.clones, kept.landmarks = copy(self.clones), copy(self.landmarks)
        return kept

    def back_to(self, kept: "FilterState") -> None:
        """Be as at a checkpoint."""
        self.__dict__.update(kept.checkpoint().__dict__)

    def propagate(self, increment: Increment) -> None:
        """Move to the end of an increment that was integrated at the current biases."""
        if not self._fej or self.far_from_first_estimates():
            self.linearise_anew()
        start = self._first
        self.R_WB, self.p_WB, self.v_WB = predict(self.R_WB, self.p_WB, self.v_WB, increment)
        Phi = transition(increment, start, (self.R_WB, self.p_WB, self.v_WB))
        Q = noise_in_world(increment, start[0])
        i = slice(0, IMU_SIZE)
        P_imu = Phi @ self._P[i, i] @ Phi.T + Q
        self._P[i, i] = 0.5 * (P_imu + P_imu.T)
        self._P[i, IMU_SIZE:] = Phi @ self._P[i, IMU_SIZE:]
        self._P[IMU_SIZE:, i] = self._P[i, IMU_SIZE:].T
        self._keep_first_estimates()

    def far_from_first_estimates(self) -> bool:
        """Whether the last frame corrected the state so much that its first estimate is no point to linearise at."""
        turn, velocity, share = _FAR_OFF
        most = velocity + share * float(np.linalg.norm(self.v_WB))
        cosine = 0.5 * (np.trace(self._first[0].T @ self.R_WB) - 1.0)
        return bool(np.linalg.norm(self.v_WB - self._first[2]) > most or cosine < np.cos(turn))

    def linearise_anew(self) -> None:
        """Make the current estimates first estimates, of the body and the clones."""
        self._keep_first_estimates()
        self.clones.R_first, self.clones.p_first = self.clones.R_WB, self.clones.p_WB

    def _keep_first_estimates(self) -> None:
        self._first = (self.R_WB, self.p_WB, self.v_WB)

    # -- clones, landmarks, calibration and prior error -------------------------------------------------------

    def add_clone(self, t_ns: int, omega_B: Vectors) -> None:
        """Append the pose at the image of camera time `t_ns` as a clone; `omega_B` (3,) rad/s is the rate there.

        The image was taken at another time than was thought if `dt_cam_imu` is wrong, and the pose differs by that
        (Li and Mourikis 2014, "Online temporal calibration for camera-IMU systems", eq. 32).
        """
        R_first, p_first, v_first = self._first
        J = np.zeros((CLONE_SIZE, IMU_SIZE + 1))
        J[:, :CLONE_SIZE] = np.eye(CLONE_SIZE)
        source = np.arange(IMU_SIZE)
        if self.estimated.time_offset:
            source = np.r_[source, self.time_offset]
            J[:3, -1], J[3:, -1] = omega_B, v_first
        J = J[:, : len(source)]
        rows = J @ self._P[source]
        self._P = _bordered(self._P, rows, rows[:, source] @ J.T, self.clone_stop)
        self.clones = self.clones.with_one(t_ns, self.R_WB, self.p_WB, R_first, p_first)

    def drop_clone(self, k: int) -> None:
        """Marginalise clone `k`; no landmark may be anchored there."""
        self._P = _without(self._P, self.clone(k))
        self.clones = self.clones.without(k)

    def add_landmarks(self, landmarks: Landmarks, by_seen: Floats, covariance: Floats) -> None:
        """Append landmarks that are linear in what the window's observations depend on.

        Args:
            landmarks: n of them.
            by_seen: (3 n, m) derivative of their `y` by the error states `seen_columns`.
            covariance: (3 n, 3 n) of the rest, independent of the state.
        """
        columns = self.seen_columns
        rows = by_seen @ self._P[columns]  # (3 n, size)
        self._P = _bordered(self._P, rows, rows[:, columns] @ by_seen.T + covariance, self.size)
        self.landmarks = self.landmarks.and_others(landmarks)

    def move_landmarks(self, mask: Mask, landmarks: Landmarks, J: Floats, columns: Stamps) -> None:
        """Describe the landmarks of `mask` (L,) otherwise, n of them.

        Args:
            mask: which.
            landmarks: their new description.
            J: (n, 3, m) derivative of the new `y` by the error states `columns` (n, m).
        """
        rows, corner = self.seen_through(J, columns)
        own = self.landmark_columns(np.flatnonzero(mask))
        self._P[own], self._P[:, own] = rows, rows.T
        self._P[np.ix_(own, own)] = 0.5 * (corner + corner.T)
        self.landmarks = self.landmarks.replaced(mask, landmarks)

    def drop_landmarks(self, mask: Mask) -> None:
        """Marginalise the landmarks of `mask` (L,)."""
        if not mask.any():
            return
        keep = np.r_[0 : self.clone_stop, self.landmark_columns(np.flatnonzero(~mask))]
        self._P = self._P[keep][:, keep]
        self.landmarks = self.landmarks.rows(~mask)

    def estimate_calibration(self, estimated: Estimated, covariance: Floats) -> None:
        """Begin to estimate parts of the calibration, known so far with this covariance (n, n); before any clone."""
        self._P = _bordered(self._P, np.zeros((len(covariance), self.size)), covariance, IMU_SIZE)
        self.estimated = estimated
        self._lay_out()

    def add_prior_error(self, mean: Floats, gain: Floats, conditional: Floats) -> None:
        """Begin to estimate the prior's error `c`, given how it hangs together with the biases.

        Before vision spoke, `c` was distributed about `mean + gain (b - b_hat)` with covariance `conditional`;
        all that the state has learned since reaches `c` through the biases alone (docs/filter.md, section 7).

        Args:
            mean: (6,) of `c` at the present biases, gain: (6, 6), conditional: (6, 6).
        """
        cross = gain @ self._P[BIASES]  # (6, n)
        corner = conditional + gain @ self._P[BIASES, BIASES] @ gain.T
        self._P = _bordered(self._P, cross, corner, self.prior_error.start)
        self.c = mean.copy()
        self._lay_out()

    def widen_biases(self, covariance: Floats) -> None:
        """Add (6, 6) to the covariance of the biases: what was known of them is doubted."""
        self._P[BIASES, BIASES] += covariance

    # -- measurement ------------------------------------------------------------------------------------------

    def update(self, H: Floats, columns: Stamps, r: Floats, R: Floats) -> Floats:
        """Kalman update with `r = z - z_hat`, `H` (m, len(columns)) by the error states `columns`, noise `R` (m, m).

        Returns the correction (size,).
        """
        HP = H @ self._P[columns]
        return self.correct(HP, HP[:, columns] @ H.T + R, r)

    def seen_through(self, H: Floats, columns: Stamps) -> tuple[Floats, Floats]:
        """H P and H P H^T of a sparse H: row block n, `H[n]` (q, m), is by the error states `columns[n]` (m,).

        Args:
            H: (N, q, m), columns: (N, m).

        Returns:
            (N q, size), (N q, N q).
        """
        N, q, m = H.shape
        rows = np.arange(0, H.size + 1, m)  # where each begins
        sparse = csr_array((H.ravel(), np.repeat(columns, q, axis=0).ravel(), rows), shape=(N * q, self.size))
        HP = sparse @ self._P
        return HP, sparse @ HP.T

    def correct(self, HP: Floats, S: Floats, r: Floats) -> Floats:
        """Kalman update by H P (m, size), innovation covariance S (m, m) and innovation r (m,).

        With S = L L^T and V = L^-1 H P the new covariance is P - V^T V, which rounding leaves exactly symmetric.
        Returns the correction (size,).
        """
        L = np.linalg.cholesky(S)
        HP_r = np.column_stack([HP, r])  # (m, size + 1)
        V_t = dtrsm(1.0, L.T, HP_r.T, side=1, overwrite_b=1)  # solves V^T L^T = (HP, r)^T, which needs no copy
        squared = V_t @ V_t.T
        self._P = self._P - squared[:-1, :-1]
        dx = squared[:-1, -1]
        self._apply(dx)
        return dx

    def _apply(self, dx: Floats) -> None:
        d = dx[self.clone_start : self.clone_stop].reshape(-1, CLONE_SIZE)
        R = np.concatenate([self.R_WB[None], self.clones.R_WB])
        R = so3.normalise(R @ so3.exp(np.concatenate([dx[None, THETA], d[:, :3]])))
        self.R_WB, self.clones.R_WB = R[0], R[1:]
        self.clones.p_WB = self.clones.p_WB + d[:, 3:]
        self.p_WB = self.p_WB + dx[POSITION]
        self.v_WB = self.v_WB + dx[VELOCITY]
        self.b_g = self.b_g + dx[GYRO_BIAS]
        self.b_a = self.b_a + dx[ACCEL_BIAS]
        if self.estimated.time_offset:
            self.dt_cam_imu += float(dx[self.time_offset][0])
        if self.estimated.camera_size:
            by_camera = dx[self.cameras].reshape(len(self.rig), -1)
            if self.estimated.extrinsics:
                self.rig = self.rig.sits_elsewhere(by_camera[:, :POSE_SIZE])
            if self.estimated.intrinsics:
                self.rig = self.rig.projects_otherwise(by_camera[:, -INTRINSICS_SIZE:])
        if self.c is not None:
            self.c = self.c + dx[self.prior_error]
        if len(self.landmarks):
            self.landmarks.y = self.landmarks.y + dx[self.clone_stop :].reshape(-1, LANDMARK_SIZE)


def _bordered(P: Floats, rows: Floats, corner: Floats, at: int) -> Floats:
    """P (n, n) with new states put in before state `at`: their covariance with P's, (m, n), and their own, (m, m)."""
    n, m = len(P), len(rows)
    out = np.empty((n + m, n + m))
    before, new, behind = slice(0, at), slice(at, at + m), slice(at + m, n + m)
    out[before, before], out[before, behind] = P[:at, :at], P[:at, at:]
    out[behind, before], out[behind, behind] = P[at:, :at], P[at:, at:]
    out[new, before], out[new, behind] = rows[:, :at], rows[:, at:]
    out[before, new], out[behind, new] = rows[:, :at].T, rows[:, at:].T
    out[new, new] = 0.5 * (corner + corner.T)
    return out


def _without(P: Floats, where: slice) -> Floats:
    """P (n, n) without the states of a slice."""
    a, b = where.start, where.stop
    n = len(P) - (b - a)
    out = np.empty((n, n))
    out[:a, :a], out[:a, a:], out[a:, :a], out[a:, a:] = P[:a, :a], P[:a, b:], P[b:, :a], P[b:, b:]
    return out

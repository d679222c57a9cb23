"""The filter's state: nominal values, first estimates and covariance under one owner (docs/filter.md, section 1)."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from msckf.blocks import ACCEL_BIAS, BIASES, GYRO_BIAS, IMU_SIZE, POSITION, THETA, VELOCITY
from msckf.propagation import Increment, noise_in_world, predict, transition
from msckf.views import Rig
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps, Vectors
from navcore.odometry import State

CLONE_SIZE = 6
LANDMARK_SIZE = 3
_FAR_OFF = (0.01, 0.03)  # rad and m/s, a correction after which first estimates are given up


@dataclass
class Clones:
    """Poses of the body at past frames, oldest first, and where each was first estimated.

    Attributes:
        t_ns: (K,) camera time.
        R_WB, p_WB: (K, 3, 3), (K, 3) current estimates.
        R_first, p_first: the same when the clone was made; linearisation points under FEJ.
    """

    t_ns: Stamps
    R_WB: Rotations
    p_WB: Vectors
    R_first: Rotations
    p_first: Vectors

    @staticmethod
    def none() -> "Clones":
        """No clones."""
        return Clones(
            np.zeros(0, dtype=np.int64),
            np.zeros((0, 3, 3)),
            np.zeros((0, 3)),
            np.zeros((0, 3, 3)),
            np.zeros((0, 3)),
        )

    def __len__(self) -> int:
        return len(self.t_ns)


@dataclass
class Landmarks:
    """Features that are part of the state.

    Attributes:
        keys: (L,) feature numbers.
        p_WF: (L, 3) m, current estimates.
        p_first: (L, 3) where each was first estimated.
    """

    keys: Stamps
    p_WF: Vectors
    p_first: Vectors

    @staticmethod
    def none() -> "Landmarks":
        """No landmarks."""
        return Landmarks(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3)))

    def __len__(self) -> int:
        return len(self.keys)


class FilterState:
    """Nominal state and covariance, changed only together.

    Error order: `dtheta, dp, dv, db_g, db_a`, then where the cameras sit (`dtheta, dp` each, if it is estimated), the
    prior's error `c` (6, likewise), clones (`dtheta, dp` each), landmarks (3 each). With `fej` off, linearisation
    points follow the current estimates.
    """

    def __init__(self, start: State, *, fej: bool = True) -> None:
        self.R_WB, self.p_WB, self.v_WB = start.R_WB.copy(), start.p_WB.copy(), start.v_WB.copy()
        self.b_g, self.b_a = start.b_g.copy(), start.b_a.copy()
        self.rig: Rig | None = None
        self.c: Floats | None = None
        self.clones = Clones.none()
        self.landmarks = Landmarks.none()
        self._fej = fej
        self._P = start.covariance.copy()
        self._keep_first_estimates()

    # -- reading ----------------------------------------------------------------------------------------------

    @property
    def covariance(self) -> Floats:
        """The whole covariance, read-only."""
        view = self._P.view()
        view.setflags(write=False)
        return view

    @property
    def size(self) -> int:
        """Number of error states."""
        return len(self._P)

    @property
    def extrinsics(self) -> slice:
        """Where the cameras' poses in B are; empty when they are not estimated."""
        return slice(IMU_SIZE, IMU_SIZE + (0 if self.rig is None else CLONE_SIZE * len(self.rig.mounts)))

    @property
    def prior_error(self) -> slice:
        """Where `c` is; empty when it is not estimated."""
        return slice(self.extrinsics.stop, self.extrinsics.stop + (0 if self.c is None else 6))

    @property
    def clone_start(self) -> int:
        """Index of the first clone's first error state."""
        return int(self.prior_error.stop)

    @property
    def seen_columns(self) -> Stamps:
        """Error states that observations over the window depend on: extrinsics and clones."""
        clones = np.arange(self.clone_start, self.clone_stop)
        return np.concatenate([np.arange(IMU_SIZE, self.prior_error.start), clones])

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
    def linearisation_landmarks(self) -> Vectors:
        """Positions (L, 3) at which measurements of landmarks are linearised."""
        return self.landmarks.p_first if self._fej else self.landmarks.p_WF

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

    def propagate(self, increment: Increment) -> None:
        """Move to the end of an increment that was integrated at the current biases."""
        if not self._fej or self._far_from_first_estimates():
            self._linearise_anew()
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

    def _far_from_first_estimates(self) -> bool:
        """Whether the last frame corrected the state so much that its first estimate is no point to linearise at."""
        turn, velocity = _FAR_OFF
        cosine = 0.5 * (np.trace(self._first[0].T @ self.R_WB) - 1.0)
        return bool(np.linalg.norm(self.v_WB - self._first[2]) > velocity or cosine < np.cos(turn))

    def _linearise_anew(self) -> None:
        """Make the current estimates first estimates, of the body, clones and landmarks alike."""
        self._keep_first_estimates()
        self.clones.R_first, self.clones.p_first = self.clones.R_WB, self.clones.p_WB
        self.landmarks.p_first = self.landmarks.p_WF

    def _keep_first_estimates(self) -> None:
        self._first = (self.R_WB, self.p_WB, self.v_WB)

    # -- clones and prior error -------------------------------------------------------------------------------

    def add_clone(self, t_ns: int) -> None:
        """Append the current pose as a clone."""
        i = self.clone_stop
        source = np.r_[0:i, THETA, POSITION, i : self.size]
        self._P = self._P[np.ix_(source, source)]
        c = self.clones
        R_first, p_first, _ = self._first
        self.clones = Clones(
            np.append(c.t_ns, np.int64(t_ns)),
            np.concatenate([c.R_WB, self.R_WB[None]]),
            np.concatenate([c.p_WB, self.p_WB[None]]),
            np.concatenate([c.R_first, R_first[None]]),
            np.concatenate([c.p_first, p_first[None]]),
        )

    def drop_clone(self, k: int) -> None:
        """Marginalise clone `k`."""
        where = self.clone(k)
        keep = np.r_[0 : where.start, where.stop : self.size]
        self._P = self._P[np.ix_(keep, keep)]
        c = self.clones
        self.clones = Clones(
            np.delete(c.t_ns, k),
            np.delete(c.R_WB, k, axis=0),
            np.delete(c.p_WB, k, axis=0),
            np.delete(c.R_first, k, axis=0),
            np.delete(c.p_first, k, axis=0),
        )

    def add_landmarks(self, keys: Stamps, p_WF: Vectors, p_first: Vectors, by_seen: Floats, covariance: Floats) -> None:
        """Append landmarks that are linear in what the window's observations depend on.

        Args:
            keys: (n,), p_WF: (n, 3) m, p_first: (n, 3) m where they are linearised.
            by_seen: (3 n, m) derivative of the positions by the error states `seen_columns`.
            covariance: (3 n, 3 n) of the rest, independent of the state.
        """
        columns = self.seen_columns
        cross = by_seen @ self._P[columns]  # (3 n, size)
        corner = cross[:, columns] @ by_seen.T + covariance
        self._P = np.block([[self._P, cross.T], [cross, 0.5 * (corner + corner.T)]])
        m = self.landmarks
        self.landmarks = Landmarks(
            np.concatenate([m.keys, keys]),
            np.concatenate([m.p_WF, p_WF]),
            np.concatenate([m.p_first, p_first]),
        )

    def drop_landmarks(self, mask: Mask) -> None:
        """Marginalise the landmarks of `mask` (L,)."""
        if not mask.any():
            return
        keep = np.r_[0 : self.clone_stop, self.landmark_columns(np.flatnonzero(~mask))]
        self._P = self._P[np.ix_(keep, keep)]
        m = self.landmarks
        self.landmarks = Landmarks(m.keys[~mask], m.p_WF[~mask], m.p_first[~mask])

    def estimate_extrinsics(self, rig: Rig, rotation_sigma: float, position_sigma: float) -> None:
        """Begin to estimate where the cameras of `rig` sit, known so far to these sigmas [rad, m]; before any clone."""
        sigma = np.tile(np.repeat([rotation_sigma, position_sigma], 3), len(rig.mounts))
        n, m = self.size, len(sigma)
        P = np.zeros((n + m, n + m))
        i = self.extrinsics.start
        old = np.r_[0:i, i + m : n + m]
        P[np.ix_(old, old)] = self._P
        P[i : i + m, i : i + m] = np.diag(sigma**2)
        self._P = P
        self.rig = rig

    def add_prior_error(self, mean: Floats, gain: Floats, conditional: Floats) -> None:
        """Begin to estimate the prior's error `c`, given how it hangs together with the biases.

        Before vision spoke, `c` was distributed about `mean + gain (b - b_hat)` with covariance `conditional`;
        all that the state has learned since reaches `c` through the biases alone (docs/filter.md, section 7).

        Args:
            mean: (6,) of `c` at the present biases, gain: (6, 6), conditional: (6, 6).
        """
        n, i = self.size, self.prior_error.start
        cross = gain @ self._P[BIASES]  # (6, n)
        P = np.zeros((n + 6, n + 6))
        old = np.r_[0:i, i + 6 : n + 6]
        new = slice(i, i + 6)
        P[np.ix_(old, old)] = self._P
        P[new, old] = cross
        P[old, new] = cross.T
        P[new, new] = conditional + gain @ self._P[BIASES, BIASES] @ gain.T
        self._P = P
        self.c = mean.copy()

    def widen_biases(self, covariance: Floats) -> None:
        """Add (6, 6) to the covariance of the biases: what was known of them is doubted."""
        self._P[BIASES, BIASES] += covariance

    # -- measurement ------------------------------------------------------------------------------------------

    def update(self, H: Floats, columns: Stamps, r: Floats, R: Floats) -> None:
        """Kalman update with `r = z - z_hat`, `H` (m, len(columns)) by the error states `columns`, noise `R` (m, m).

        With S = L L^T and V = L^-1 H P the new covariance is P - V^T V, which rounding leaves exactly symmetric.
        """
        PHt = self._P[:, columns] @ H.T
        L = np.linalg.cholesky(H @ PHt[columns] + R)
        V = solve_triangular(L, PHt.T, lower=True, check_finite=False)  # (m, n)
        self._P = self._P - V.T @ V
        self._apply(V.T @ solve_triangular(L, r, lower=True, check_finite=False))

    def _apply(self, dx: Floats) -> None:
        self.R_WB = so3.normalise(self.R_WB @ so3.exp(dx[THETA]))
        self.p_WB = self.p_WB + dx[POSITION]
        self.v_WB = self.v_WB + dx[VELOCITY]
        self.b_g = self.b_g + dx[GYRO_BIAS]
        self.b_a = self.b_a + dx[ACCEL_BIAS]
        if self.rig is not None:
            self.rig = self.rig.moved(dx[self.extrinsics].reshape(-1, CLONE_SIZE))
        if self.c is not None:
            self.c = self.c + dx[self.prior_error]
        if len(self.clones):
            d = dx[self.clone_start : self.clone_stop].reshape(-1, CLONE_SIZE)
            self.clones.R_WB = so3.normalise(self.clones.R_WB @ so3.exp(d[:, :3]))
            self.clones.p_WB = self.clones.p_WB + d[:, 3:]
        if len(self.landmarks):
            self.landmarks.p_WF = self.landmarks.p_WF + dx[self.clone_stop :].reshape(-1, LANDMARK_SIZE)

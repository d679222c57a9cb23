"""What outlives a loss: the pose that was given out last, and what was learned (docs/filter.md, section 8)."""

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from msckf.blocks import BIASES, POSITION, THETA, VELOCITY
from msckf.config import CalibrationConfig
from msckf.estimated import Estimated
from msckf.propagation import integrate
from msckf.state import FilterState
from msckf.views import Rig
from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells
from navcore.odometry import State

_DOUBT = 2.0  # factor on the standard deviations of what was learned
_SPACING_S = 2.0  # between two times at which it is remembered
_UNSEEN_RATE = 0.5  # rad/s, standard deviation of the yaw rate where no sample covers it
_e_z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Learned:
    """What a filter had learned of its sensors at IMU time `t_ns`.

    Attributes:
        mean: (12,) b_g, b_a and the prior's error c, zero where that is not estimated.
        covariance: (12, 12) of it.
        rig, dt_cam_imu: the calibration as estimated.
        calibration: (n, n) covariance of what is estimated of it, in the order of `Estimated`.
    """

    t_ns: int
    mean: Floats
    covariance: Floats
    rig: Rig
    dt_cam_imu: float
    calibration: Floats

    @staticmethod
    def of(state: FilterState, t_ns: int) -> "Learned":
        """What a state knows, with some doubt: what came before a loss may have had a part in it."""
        mean, covariance = np.zeros(12), np.zeros((12, 12))
        n = 6 if state.c is None else 12
        columns = np.r_[BIASES, state.prior_error]
        mean[:n] = state.biases if state.c is None else np.concatenate([state.biases, state.c])
        covariance[:n, :n] = _DOUBT**2 * state.covariance[np.ix_(columns, columns)]
        calibration = state.covariance[state.calibration, state.calibration].copy()
        return Learned(t_ns, mean, covariance, state.rig, state.dt_cam_imu, calibration)

    def doubted_calibration(self, estimated: Estimated, config: CalibrationConfig) -> Floats:
        """The covariance of the calibration with the same doubt, but no more than there was beforehand."""
        before = estimated.sigmas(config, len(self.rig))
        sigma = np.sqrt(np.diagonal(self.calibration))
        factor = np.clip(before / np.maximum(sigma, 1e-12), 1.0, _DOUBT)
        return np.asarray(self.calibration * np.outer(factor, factor))


class Memory:
    """Remembers, while all is well, what was learned; gives what was known some seconds before a loss."""

    def __init__(self) -> None:
        self._kept: deque[Learned] = deque(maxlen=2)

    def note(self, state: FilterState, t_ns: int) -> None:
        """All is well with this state."""
        if not self._kept or t_ns - self._kept[-1].t_ns >= _SPACING_S * 1e9:
            self._kept.append(Learned.of(state, t_ns))

    @property
    def learned(self) -> Learned | None:
        """What is to be believed after a loss."""
        return self._kept[0] if self._kept else None


@dataclass(frozen=True)
class LastPose:
    """The pose that was given out last, turned since by what the gyro says.

    Attributes:
        t_ns: up to when; since_ns: when it was given out. IMU time.
        R_WB, p_WB: (3, 3), (3,) m.
        speed: m/s, then.
        yaw_variance: rad^2; position_covariance: (3, 3) m^2, without what the body has moved since.
    """

    t_ns: int
    since_ns: int
    R_WB: Rotations
    p_WB: Vectors
    speed: float
    yaw_variance: float
    position_covariance: Floats

    @staticmethod
    def of(state: State, t_ns: int) -> "LastPose":
        """Of an estimate."""
        up = state.R_WB.T @ _e_z  # in B
        yaw_variance = float(up @ state.covariance[THETA, THETA] @ up)
        speed = float(np.linalg.norm(state.v_WB))
        P = state.covariance[POSITION, POSITION]
        return LastPose(t_ns, t_ns, state.R_WB, state.p_WB, speed, yaw_variance, P)

    def turned(self, t_ns: int, cells: Cells, b_g: Vectors, noise: ImuNoise) -> "LastPose":
        """The pose turned through the cells up to IMU time `t_ns`; where no sample covers them it is left as it is."""
        if len(cells.dt) == 0:
            return self
        covered = cells.bridged == 0.0
        kept = Cells(cells.dt[covered], cells.gyro[covered], cells.accel[covered], cells.bridged[covered])
        increment = integrate(kept, b_g, np.zeros(3), noise)
        unseen_s = float(cells.dt[~covered].sum())
        return replace(
            self,
            t_ns=t_ns,
            R_WB=so3.normalise(self.R_WB @ increment.delta_R),
            yaw_variance=self.yaw_variance + float(increment.Q[0, 0]) + (_UNSEEN_RATE * unseen_s) ** 2,
        )


def continued(state: State, last: LastPose, max_speed: float) -> State:
    """A new start at IMU time `last.t_ns`, turned and moved so that heading and position go on from the last pose.

    The start knows position and yaw exactly, as its own origin. In the world of the last pose they are known as that
    was, plus what the body may have moved since: nobody watched, but no farther than its speed could carry it.
    """
    turn = so3.exp(np.array([0.0, 0.0, _heading(last.R_WB) - _heading(state.R_WB)]))
    T = np.eye(15)
    T[POSITION, POSITION] = T[VELOCITY, VELOCITY] = turn
    R_WB, v_WB = turn @ state.R_WB, turn @ state.v_WB
    P = T @ state.covariance @ T.T
    by_yaw = np.zeros(15)
    by_yaw[THETA], by_yaw[VELOCITY] = R_WB.T @ _e_z, np.cross(_e_z, v_WB)
    P += last.yaw_variance * np.outer(by_yaw, by_yaw)
    speed = max(min(last.speed, max_speed), float(np.linalg.norm(v_WB)))
    moved = speed * (last.t_ns - last.since_ns) * 1e-9
    P[POSITION, POSITION] += last.position_covariance + moved**2 * np.eye(3)
    return replace(state, R_WB=R_WB, p_WB=last.p_WB.copy(), v_WB=v_WB, covariance=P)


def _heading(R_WB: Rotations) -> float:
    return float(np.arctan2(R_WB[1, 0], R_WB[0, 0]))


def disagreement(state: State, other: State) -> float:
    """Normalised squared difference of what two states say about velocity and down, in B: five are expected."""
    r, S = np.zeros(6), np.zeros((6, 6))
    for s, sign in ((state, 1.0), (other, -1.0)):
        v_B, up_B = s.R_WB.T @ s.v_WB, s.R_WB.T @ _e_z
        H = np.zeros((6, 15))
        H[:3, THETA], H[:3, VELOCITY], H[3:, THETA] = so3.hat(v_B), s.R_WB.T, so3.hat(up_B)
        r += sign * np.concatenate([v_B, up_B])
        S += H @ s.covariance @ H.T
    S[3:, 3:] += 1e-6 * np.eye(3)  # up is a unit vector: along it nothing is to be known
    return float(r @ np.linalg.solve(S, r))

"""The pose that was given out last, and how a new start goes on from it."""

from dataclasses import dataclass, replace

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Rotations, Vectors
from navcore.imu import ImuNoise
from navcore.imu_buffer import Cells
from navcore.odometry import State

_UNSEEN_RATE = 0.5  # rad/s, standard deviation of the yaw rate where no sample covers it
_e_z = np.array([0.0, 0.0, 1.0])
_THETA, _POSITION, _VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)


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
        yaw_variance = float(up @ state.covariance[_THETA, _THETA] @ up)
        speed = float(np.linalg.norm(state.v_WB))
        P = state.covariance[_POSITION, _POSITION]
        return LastPose(t_ns, t_ns, state.R_WB, state.p_WB, speed, yaw_variance, P)

    def turned(self, t_ns: int, cells: Cells, b_g: Vectors, noise: ImuNoise) -> "LastPose":
        """The pose turned through the cells up to IMU time `t_ns`; where no sample covers them it is left as it is."""
        if len(cells.dt) == 0:
            return self
        covered = cells.bridged == 0.0
        dt = cells.dt[covered]
        R_WB = self.R_WB
        for step in so3.exp((cells.gyro[covered] - b_g) * dt[:, None]):
            R_WB = R_WB @ step
        unseen_s = float(cells.dt[~covered].sum())
        white = noise.gyroscope_noise_density**2 * float(dt.sum())
        return replace(
            self,
            t_ns=t_ns,
            R_WB=so3.normalise(R_WB),
            yaw_variance=self.yaw_variance + white + (_UNSEEN_RATE * unseen_s) ** 2,
        )


def continued(state: State, last: LastPose, max_speed: float) -> State:
    """A new start at IMU time `last.t_ns`, turned and moved so that heading and position go on from the last pose.

    The start knows position and yaw exactly, as its own origin. In the world of the last pose they are known as that
    was, plus what the body may have moved since: nobody watched, but no farther than its speed could carry it.
    """
    turn = so3.exp(np.array([0.0, 0.0, _heading(last.R_WB) - _heading(state.R_WB)]))
    T = np.eye(15)
    T[_POSITION, _POSITION] = T[_VELOCITY, _VELOCITY] = turn
    R_WB, v_WB = turn @ state.R_WB, turn @ state.v_WB
    P = T @ state.covariance @ T.T
    by_yaw = np.zeros(15)
    by_yaw[_THETA], by_yaw[_VELOCITY] = R_WB.T @ _e_z, np.cross(_e_z, v_WB)
    P += last.yaw_variance * np.outer(by_yaw, by_yaw)
    speed = max(min(last.speed, max_speed), float(np.linalg.norm(v_WB)))
    moved = speed * (last.t_ns - last.since_ns) * 1e-9
    P[_POSITION, _POSITION] += last.position_covariance + moved**2 * np.eye(3)
    return replace(state, R_WB=R_WB, p_WB=last.p_WB.copy(), v_WB=v_WB, covariance=P)


def _heading(R_WB: Rotations) -> float:
    return float(np.arctan2(R_WB[1, 0], R_WB[0, 0]))

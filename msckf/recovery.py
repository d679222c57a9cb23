"""What outlives a loss: what was learned of the sensors; and whether two states are the same (docs/filter.md, 8)."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from msckf.blocks import BIASES, THETA, VELOCITY
from msckf.config import CalibrationConfig
from msckf.estimated import Estimated
from msckf.state import FilterState
from msckf.views import Rig
from navcore import so3
from navcore.arrays import Floats
from navcore.odometry import State

_DOUBT = 2.0  # factor on the standard deviations of what was learned
_SPACING_S = 2.0  # between two times at which it is remembered
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

"""How a rig turns, by its own gyro: what ties degradations to the world where nobody knows the pose."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Rotations, Stamps, Vectors
from navcore.imu import ImuSamples

_STILL_S = 1.0  # the stretch over which a bias is taken
_STILL_SD = 0.01  # rad/s: a gyro that scatters more is moving
_LARGEST = 0.2  # rad/s: what is steady and larger is a turn, not a bias


@dataclass(frozen=True)
class Attitude:
    """Attitude by integration, from the identity at the first sample; what drifts, drifts slowly.

    Attributes:
        t_ns: (N,) stamps of the samples.
        R_WB: (N, 3, 3) there; W is B at the first sample.
        omega_B: (N, 3) rad/s, bias removed.
    """

    t_ns: Stamps
    R_WB: Rotations
    omega_B: Vectors

    @staticmethod
    def of(imu: ImuSamples, b_g: Vectors | None = None) -> "Attitude":
        """From samples and their bias (N, 3) rad/s; if unknown, that is the rate of the stillest second, if still."""
        omega = imu.gyro - (resting_rate(imu) if b_g is None else b_g)
        steps = np.diff(imu.t_ns)[:, None] * 1e-9 * 0.5 * (omega[:-1] + omega[1:])
        R_WB = np.empty((len(imu), 3, 3))
        R_WB[0] = np.eye(3)
        for k, turn in enumerate(so3.exp(steps)):
            R_WB[k + 1] = R_WB[k] @ turn
        return Attitude(imu.t_ns, so3.normalise(R_WB), omega)

    def at(self, t_ns: Stamps) -> Rotations:
        """R_WB (N, 3, 3) at stamps (N,) of IMU time; beyond the samples the last rate goes on."""
        k = np.clip(np.searchsorted(self.t_ns, t_ns, side="right") - 1, 0, max(0, len(self.t_ns) - 2))
        other = np.minimum(k + 1, len(self.t_ns) - 1)
        rate = 0.5 * (self.omega_B[k] + self.omega_B[other])
        turn = rate * ((t_ns - self.t_ns[k]) * 1e-9)[:, None]
        R_WB: Rotations = self.R_WB[k] @ so3.exp(turn)
        return R_WB


def resting_rate(imu: ImuSamples) -> Vectors:
    """(3,) rad/s: the mean rate of the stillest second, or zero if the gyro was never still."""
    rate_hz = (len(imu) - 1) / max((int(imu.t_ns[-1]) - int(imu.t_ns[0])) * 1e-9, 1e-9)
    n = max(2, round(_STILL_S * rate_hz))
    pieces = len(imu) // n
    if pieces == 0:
        return np.zeros(3)
    stretches = imu.gyro[: pieces * n].reshape(pieces, n, 3)
    scatter = np.linalg.norm(stretches.std(axis=1), axis=1)
    best = int(np.argmin(scatter))
    rate: Vectors = stretches[best].mean(axis=0)
    return rate if scatter[best] < _STILL_SD and np.linalg.norm(rate) < _LARGEST else np.zeros(3)

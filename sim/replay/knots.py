"""The path that is being smoothed: states at the edges of the IMU's sampling intervals."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Rotations, Stamps, Vectors
from navcore.imu import GRAVITY, ImuSamples
from sim.replay.chain import B_A, B_G, THETA, P, V

g_W = np.array([0.0, 0.0, -GRAVITY])


@dataclass(frozen=True)
class Intervals:
    """What the IMU measured between knots: N samples, each over its own interval.

    Attributes:
        t_ns: (N+1,) knots: halfway between stamps.
        imu: the N samples.
    """

    t_ns: Stamps
    imu: ImuSamples

    @staticmethod
    def of(imu: ImuSamples) -> "Intervals":
        """The intervals of samples: a sample is the mean around its stamp."""
        middle = imu.t_ns[:-1] + np.diff(imu.t_ns) // 2
        first, last = 2 * imu.t_ns[0] - middle[0], 2 * imu.t_ns[-1] - middle[-1]
        return Intervals(np.concatenate([[first], middle, [last]]), imu)

    @property
    def h(self) -> Floats:
        """(N,) s."""
        return np.diff(self.t_ns) * 1e-9

    def locate(self, t_ns: Stamps) -> tuple[Stamps, Floats]:
        """The interval of each stamp, and seconds since its beginning."""
        last = np.searchsorted(self.t_ns, t_ns, side="right").astype(np.int64) - 1
        k: Stamps = np.clip(last, 0, len(self.imu) - 1)
        tau = (t_ns - self.t_ns[k]).astype(np.float64) * 1e-9
        return k, tau


@dataclass(frozen=True)
class Knots:
    """States at K knots: R_WB (K, 3, 3), p_WB, v_WB (K, 3), biases b_g, b_a (K, 3) of the interval that follows."""

    R_WB: Rotations
    p_WB: Vectors
    v_WB: Vectors
    b_g: Vectors
    b_a: Vectors

    def moved(self, dx: Floats) -> "Knots":
        """The states after an error-state step (K, 15)."""
        R_WB = so3.normalise(self.R_WB @ so3.exp(dx[:, THETA]))
        p, v, b_g, b_a = self.p_WB + dx[:, P], self.v_WB + dx[:, V], self.b_g + dx[:, B_G], self.b_a + dx[:, B_A]
        return Knots(R_WB, p, v, b_g, b_a)


def second_integral(phi: Vectors) -> Floats:
    """(..., 3, 3): twofold integral of Exp(s phi) over s in [0, 1], for turns within a sampling interval."""
    K = so3.hat(phi)
    return 0.5 * np.eye(3) + K / 6.0 + K @ K / 24.0


def turned(R: Floats, x: Vectors) -> Vectors:
    """(..., 3, 3) times (..., 3)."""
    out: Vectors = (R @ x[..., None])[..., 0]
    return out

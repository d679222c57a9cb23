"""The true motion of a body, fine enough that everything an IMU or a camera sees follows from it."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Rotations, Stamps, Vectors, frozen
from navcore.imu import GRAVITY
from navcore.trajectory import Trajectory
from sim.errors import ConfigError

EPOCH_NS = 1_700_000_000_000_000_000
"""Stamp of second zero of every recording; large, as real stamps are, so that rounding shows."""

_g_W = np.array([0.0, 0.0, -GRAVITY])


@dataclass(frozen=True)
class Motion:
    """States on a uniform grid of M knots, and between knots a constant body rate and specific force.

    Rotation and velocity obey that rate and force exactly from knot to knot. Position is the physics' own;
    what the constant force would give differs by h^3/12 of the jerk a step (1e-9 m at 1 ms), which does not
    add up.

    Attributes:
        step_s: seconds between knots, h.
        R_WB: (M, 3, 3) at the knots.
        p_WB: (M, 3) m, at the knots.
        v_WB: (M, 3) m/s, at the knots.
        omega_B: (M-1, 3) rad/s in B, between the knots.
        specific_force_B: (M-1, 3) m/s^2 in B, between the knots.
        start_ns: stamp of the first knot.
    """

    step_s: float
    R_WB: Rotations
    p_WB: Vectors
    v_WB: Vectors
    omega_B: Vectors
    specific_force_B: Vectors
    start_ns: int = EPOCH_NS

    def __post_init__(self) -> None:
        M = len(self.R_WB)
        if M < 2 or not self.step_s > 0.0:
            raise ConfigError(f"a motion needs two states and a step above zero, got {M} and {self.step_s} s")
        object.__setattr__(self, "R_WB", frozen("R_WB", self.R_WB, np.float64, (M, 3, 3)))
        for name, n in (("p_WB", M), ("v_WB", M), ("omega_B", M - 1), ("specific_force_B", M - 1)):
            object.__setattr__(self, name, frozen(name, getattr(self, name), np.float64, (n, 3)))

    @staticmethod
    def from_states(step_s: float, R_WB: Rotations, p_WB: Vectors, v_WB: Vectors, start_ns: int = EPOCH_NS) -> "Motion":
        """The motion through states (M, 3, 3), (M, 3) m, (M, 3) m/s.

        The rate is `Log(R_k^T R_{k+1}) / h`. The force solves `v_{k+1} - v_k - g h = R_k J_l(omega h) f h`:
        J_l is the mean of Exp over the step (Solà, Deray, Atchuthan 2018, eq. (145)).
        """
        phi = so3.log(np.swapaxes(R_WB[:-1], 1, 2) @ R_WB[1:])
        dv_W = np.diff(v_WB, axis=0) / step_s - _g_W
        dv_B = (np.swapaxes(R_WB[:-1], 1, 2) @ dv_W[..., None])[..., 0]
        force = (so3.left_jacobian_inverse(phi) @ dv_B[..., None])[..., 0]
        return Motion(step_s, R_WB, p_WB, v_WB, phi / step_s, force, start_ns)

    @property
    def duration_s(self) -> float:
        """Seconds from the first knot to the last."""
        return (len(self.R_WB) - 1) * self.step_s

    @property
    def end_ns(self) -> int:
        """Stamp of the last knot."""
        return self.start_ns + round(self.duration_s * 1e9)

    @property
    def length(self) -> float:
        """Length of the path [m]."""
        return float(np.linalg.norm(np.diff(self.p_WB, axis=0), axis=1).sum())

    def after(self, seconds: float) -> "Motion":
        """The motion without its first `seconds`, beginning at the same stamp."""
        k = round(seconds / self.step_s)
        states = (self.R_WB[k:], self.p_WB[k:], self.v_WB[k:])
        return Motion(self.step_s, *states, self.omega_B[k:], self.specific_force_B[k:], self.start_ns)

    def resampled(self, t_ns: Stamps, step_s: float) -> "Motion":
        """The motion on coarser knots at stamps (N,), `step_s` apart."""
        states = self.at(t_ns)
        assert states.v_WB is not None
        return Motion.from_states(step_s, states.R_WB, states.p_WB, states.v_WB, int(t_ns[0]))

    def at(self, t_ns: Stamps) -> Trajectory:
        """The true states at stamps (N,), exact between knots too.

        Raises:
            ConfigError: a stamp lies outside the motion.
        """
        t_ns = np.asarray(t_ns, dtype=np.int64)
        s = (t_ns - self.start_ns) * 1e-9
        if np.any((s < -1e-9) | (s > self.duration_s + 1e-9)):
            raise ConfigError(f"the motion lasts {self.duration_s:.3f} s; asked for {s.min():.4f} to {s.max():.4f} s")
        k = np.clip((s / self.step_s).astype(np.int64), 0, len(self.omega_B) - 1)
        tau = (s - k * self.step_s)[:, None]
        phi, force = self.omega_B[k] * tau, self.specific_force_B[k]
        R = self.R_WB[k]
        a_mean = (R @ so3.left_jacobian(phi) @ force[..., None])[..., 0] + _g_W
        # Over 1 ms the rotation's part in the second integral is below 1e-10 m: one mean force serves both.
        p = self.p_WB[k] + self.v_WB[k] * tau + 0.5 * a_mean * tau**2
        return Trajectory(t_ns, so3.to_quaternion(R @ so3.exp(phi)), p, self.v_WB[k] + a_mean * tau)

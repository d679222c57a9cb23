"""A flight whose truth is spoilt as motion capture spoils it, in ways that are known."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Mask, Stamps
from navcore.calibration import Calibration
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory
from sim.imu import grade, simulate_imu
from sim.motion import Motion
from sim.rig import euroc_like

TURN_OFFSET_S, SHIFT_OFFSET_S = 0.004, -0.007
R_VW = so3.exp(np.array([0.03, -0.02, 0.0]))
R_BT = so3.exp(np.array([0.01, -0.02, 0.015]))
P_BT = np.array([0.006, -0.004, 0.009])


@dataclass(frozen=True)
class Spoilt:
    """A recording and what is behind it."""

    recording: Sequence
    motion: Motion
    ideal: Trajectory  # states at the IMU's stamps, with biases


def spoil(
    motion: Motion, gap_s: tuple[float, float] = (0.0, 0.0), outliers: int = 0, lean_rad: float = 0.0, seed: int = 0
) -> Spoilt:
    """Truth at 120 Hz, 2 mrad and 1 mm of jitter, tilted, turned, late, with a gap and flipped poses.

    `lean_rad` is how far its attitude errs, per axis, in a way that changes over three seconds.
    """
    rng = np.random.default_rng(seed)
    device = grade("adis16448")
    samples, ideal = simulate_imu(motion, device, rng)
    t_ns = _stamps(motion, gap_s)
    attitude = motion.at(t_ns + round(TURN_OFFSET_S * 1e9)).R_WB
    place = motion.at(t_ns + round(SHIFT_OFFSET_S * 1e9))
    R = R_VW @ attitude @ R_BT @ so3.exp(2e-3 * rng.standard_normal((len(t_ns), 3)))
    p = (place.p_WB + place.R_WB @ P_BT) @ R_VW.T + 1e-3 * rng.standard_normal((len(t_ns), 3))
    wrong = rng.choice(len(t_ns), outliers, replace=False)
    s = (t_ns - t_ns[0]) * 1e-9
    R = R @ so3.exp(lean_rad * np.sqrt(2.0) * np.sin(2.0 * np.pi * s[:, None] / 3.0 + np.array([0.0, 1.0, 2.0])))
    R[wrong] = R[wrong] @ so3.exp(np.array([0.0, 0.0, 3.0]))
    p[wrong] += 0.1 * rng.standard_normal((outliers, 3))
    calibration = Calibration(device.noise, euroc_like(device.noise, 2).cameras)
    truth = Trajectory(t_ns, so3.to_quaternion(R), p)
    return Spoilt(Sequence("spoilt", calibration, samples, (), truth), motion, ideal)


def _stamps(motion: Motion, gap_s: tuple[float, float]) -> Stamps:
    s = np.arange(0.05, motion.duration_s - 0.05, 1.0 / 120.0)
    outside: Mask = (s < gap_s[0]) | (s >= gap_s[1])
    stamps: Stamps = motion.start_ns + np.rint(s[outside] * 1e9).astype(np.int64)
    return stamps

"""The path that a recording's truth and its IMU agree on: a batch maximum-a-posteriori smoother."""

from dataclasses import dataclass, replace

import numpy as np

from navcore.arrays import Floats
from navcore.errors import DataError
from navcore.imu import ImuNoise
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory
from sim.replay import increments
from sim.replay.begin import first_knots
from sim.replay.chain import B_A, B_G, THETA, Normal, P
from sim.replay.fixes import Fixes, attitudes, positions
from sim.replay.knots import Intervals, Knots
from sim.replay.mounting import PRIOR_SD, SIZE, Mounting

MAX_STEPS = 30

GYRO_IN_MOTION, ACCELEROMETER_IN_MOTION = 2.0, 4.0
"""An IMU that moves errs by more than its white noise at rest (scale, alignment, vibration): its densities
times this."""

ATTITUDES_ALIKE_S = 1.0
"""Motion capture errs in attitude by milliradians that stay alike for about so long: within it, all its attitudes
count as one."""

_ENOUGH = (1e-4, 5e-4)  # rad and m by which no knot moves any more
_MARGIN_NS = 60_000_000  # IMU wanted beyond truth: more than its clock can be off
_FIRST_SD = 0.02  # rad and m, scale of truth's errors to begin with
_LONGEST_STEP_S = 0.1  # between IMU samples
_GYRO_BIAS_SD, _ACCELEROMETER_BIAS_SD = 0.5, 1.0  # rad/s and m/s^2, of the first: next to nothing is known


@dataclass(frozen=True)
class Smoothed:
    """The outcome of smoothing, at the knots.

    Attributes:
        truth: what was smoothed.
        intervals: the IMU's.
        knots: the path.
        mounting: the constants.
        covariance: (K, 15, 15) of the knots.
        mounting_sd: (10,).
        attitudes, positions: truth against the path.
        turn_sd, shift_sd: scales of truth's errors per axis, rad and m.
    """

    truth: Trajectory
    intervals: Intervals
    knots: Knots
    mounting: Mounting
    covariance: Floats
    mounting_sd: Floats
    attitudes: Fixes
    positions: Fixes
    turn_sd: float
    shift_sd: float


def smooth(sequence: Sequence) -> Smoothed:
    """Smooth a recording's truth with its IMU by Gauss-Newton on a chain of knots.

    Unknowns: attitude, position, velocity and both biases at every edge of the IMU's sampling intervals, and
    the constants of `Mounting`. Factors: the samples under their calibrated noise and bias walk, truth's poses
    under Student's t, whose two scales are fitted on the way.

    Raises:
        DataError: no truth, too little of it within the IMU's span, or no path that fits it.
    """
    truth, intervals = _common_span(sequence)
    noise = in_motion(sequence.calibration.imu)
    knots, mounting = first_knots(truth, intervals), Mounting.none()
    turn_sd = shift_sd = _FIRST_SD
    alike = min(1.0, float(np.median(np.diff(truth.t_ns))) * 1e-9 / ATTITUDES_ALIKE_S)
    for _ in range(MAX_STEPS):
        turns, shifts = (see(truth, knots, intervals, mounting) for see in (attitudes, positions))
        turn_sd, shift_sd = turns.refit(turn_sd), shifts.refit(shift_sd)
        normal = Normal.empty(len(intervals.t_ns), SIZE)
        increments.add(normal, knots, intervals, noise)
        turns.add(normal, turn_sd, alike)
        shifts.add(normal, shift_sd)
        _add_beliefs(normal, knots, mounting)
        solution = normal.solve()
        knots, mounting = knots.moved(solution.knots), mounting.moved(solution.constants)
        moved = [float(np.abs(solution.knots[:, which]).max()) for which in (THETA, P)]
        if not np.all(np.isfinite(moved)):
            break
        if moved[0] < _ENOUGH[0] and moved[1] < _ENOUGH[1]:
            turns, shifts = (see(truth, knots, intervals, mounting) for see in (attitudes, positions))
            sds = np.sqrt(np.diag(solution.P_cc))
            return Smoothed(
                truth, intervals, knots, mounting, solution.covariances(), sds, turns, shifts, turn_sd, shift_sd
            )
    raise DataError(f"{sequence.name}: truth and IMU do not agree on a path (last step {moved[0]} rad, {moved[1]} m)")


def in_motion(noise: ImuNoise) -> ImuNoise:
    """The noise that samples are believed to have."""
    return replace(
        noise,
        gyroscope_noise_density=GYRO_IN_MOTION * noise.gyroscope_noise_density,
        accelerometer_noise_density=ACCELEROMETER_IN_MOTION * noise.accelerometer_noise_density,
    )


def _common_span(sequence: Sequence) -> tuple[Trajectory, Intervals]:
    truth, imu = sequence.truth, sequence.imu
    if truth is None or len(truth) < 2 or len(imu) < 2:
        raise DataError(f"{sequence.name}: has no truth with an IMU beside it; a replay needs both")
    imu = imu.between(int(truth.t_ns[0]) - _MARGIN_NS, int(truth.t_ns[-1]) + _MARGIN_NS)
    if len(imu) < 2:
        raise DataError(f"{sequence.name}: truth and IMU have no time in common")
    intervals = Intervals.of(imu)
    inside = truth.between(int(intervals.t_ns[0]), int(intervals.t_ns[-1]))
    if len(inside) < 2:
        raise DataError(f"{sequence.name}: truth and IMU have no time in common")
    widest = int(np.argmax(intervals.h))
    if intervals.h[widest] > _LONGEST_STEP_S:
        at = f"{intervals.h[widest]:.3f} s after {intervals.t_ns[widest]} ns"
        raise DataError(f"{sequence.name}: IMU samples are missing for {at}; truth cannot be smoothed across")
    return inside, intervals


def _add_beliefs(normal: Normal, knots: Knots, mounting: Mounting) -> None:
    """What is known before: next to nothing, so that nothing is unknown altogether."""
    first = ((B_G, knots.b_g[0], _GYRO_BIAS_SD), (B_A, knots.b_a[0], _ACCELEROMETER_BIAS_SD))
    for which, value, sd in first:
        normal.own[0, which, which] += np.eye(3) / sd**2
        normal.g[0, which] -= value / sd**2
    normal.corner += np.diag(PRIOR_SD**-2.0)
    normal.g_c -= mounting.error() / PRIOR_SD**2

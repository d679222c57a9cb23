"""Truth for a replay: a path that agrees with the real IMU, and where it is known."""

from dataclasses import dataclass, replace

import numpy as np

from navcore.arrays import Mask, Stamps
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory
from sim.motion import Motion
from sim.replay.path import motion_along
from sim.replay.smooth import Smoothed, smooth

LIMIT_M = 0.02
"""Where the path's own standard deviation of position is above this, it is not known."""

_GAP_S = 0.1  # truth's poses further apart than this are a gap


@dataclass(frozen=True)
class SmoothedTruth:
    """A recording's truth, smoothed with its IMU; stamps are the IMU's time, W is upright.

    Attributes:
        motion: the path from truth's first pose to its last, on a grid of 1 ms; where truth has a gap, the
            IMU's way across.
        truth: its states at the IMU's stamps with the estimated biases, without the spans that are not known.
        left_out_ns: (L, 2) spans in which the path is not known to `LIMIT_M`.
        bridged_ns: (G, 2) gaps of truth that the IMU bridges.
        smoothed: all else that came out of smoothing.
    """

    motion: Motion
    truth: Trajectory
    left_out_ns: Stamps
    bridged_ns: Stamps
    smoothed: Smoothed

    def known(self, t_ns: Stamps) -> Mask:
        """Whether the path is known at stamps (N,)."""
        return _known(t_ns, self.motion, self.left_out_ns)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done to truth and what is left out, a line each."""
        m = self.smoothed.mounting
        turn, shift = 1e3 * m.turn_offset_s, 1e3 * m.shift_offset_s
        lines = [
            f"truth is smoothed with the IMU; found: offset {turn:+.2f} ms of attitude, {shift:+.2f} ms of position, "
            f"tilt {np.rad2deg(m.tilt_rad):.2f} deg, body turned {np.rad2deg(m.turn_rad):.2f} deg; "
            "biases in it are estimates"
        ]
        if len(self.bridged_ns):
            seconds = np.diff(self.bridged_ns, axis=1)[:, 0] * 1e-9
            lines.append(f"{len(seconds)} gap(s) of truth, up to {seconds.max():.2f} s, are bridged with the IMU")
        for low, high in self.left_out_ns.tolist():
            seconds = (high - low) * 1e-9
            lines.append(f"left out: {seconds:.2f} s from {low} ns, where too little truth or motion tells the path")
        return tuple(lines)


def smooth_truth(sequence: Sequence) -> SmoothedTruth:
    """Smooth a recording's truth with its IMU.

    Raises:
        DataError: no truth, too little of it within the IMU's span, or no path that fits both.
    """
    found = smooth(sequence)
    offset = round(found.mounting.turn_offset_s * 1e9)
    fixes_ns = found.truth.t_ns + offset
    t_ns = found.intervals.t_ns
    start, end = max(int(fixes_ns[0]), int(t_ns[0])), min(int(fixes_ns[-1]), int(t_ns[-1]))
    motion = motion_along(found.knots, found.intervals, start, end)
    sd = np.sqrt(np.linalg.eigvalsh(found.covariance[:, 3:6, 3:6])[:, -1])
    left_out = _spans(t_ns, sd > LIMIT_M)
    gap = np.flatnonzero(np.diff(fixes_ns) > _GAP_S * 1e9)
    gaps = np.stack([fixes_ns[gap], fixes_ns[gap + 1]], axis=1)
    bridged = gaps[[not np.any((left_out[:, 0] < high) & (left_out[:, 1] > low)) for low, high in gaps.tolist()]]
    return SmoothedTruth(motion, _states(found, motion, left_out), left_out, bridged.reshape(-1, 2), found)


def _known(t_ns: Stamps, motion: Motion, left_out_ns: Stamps) -> Mask:
    known = (t_ns >= motion.start_ns) & (t_ns <= motion.end_ns)
    for low, high in left_out_ns.tolist():
        known &= (t_ns < low) | (t_ns > high)
    return np.asarray(known)


def _states(found: Smoothed, motion: Motion, left_out_ns: Stamps) -> Trajectory:
    """The path's states at the IMU's stamps where they are known."""
    stamps = found.intervals.imu.t_ns
    known = _known(stamps, motion, left_out_ns)
    states = motion.at(stamps[known])
    return replace(states, b_g=found.knots.b_g[:-1][known], b_a=found.knots.b_a[:-1][known])


def _spans(t_ns: Stamps, mask: Mask) -> Stamps:
    """(L, 2) first and last stamp of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return np.stack([t_ns[edges[0::2]], t_ns[edges[1::2] - 1]], axis=1)

"""Where the IMU is held against the truth: poses about a second apart, and the segments between them."""

from dataclasses import dataclass

import numpy as np

from ipnet.errors import LabelError
from ipnet.preintegration import coverage
from ipnet.windows import MAX_GAP_S
from navcore.arrays import Mask, Rotations, Stamps, Vectors
from navcore.imu import ImuSamples
from navcore.trajectory import Trajectory

FEWEST = 8
"""Neighbouring segments below which there is no label."""


@dataclass(frozen=True)
class Nodes:
    """Poses of the truth, as they are: none is interpolated.

    Attributes:
        t_ns: (N,).
        R_WB: (N, 3, 3).
        p_WB: (N, 3) m.
        joined: (N - 1,) whether a node and the next are the ends of a segment.
        span_ns: first and last time of truth and IMU together.
    """

    t_ns: Stamps
    R_WB: Rotations
    p_WB: Vectors
    joined: Mask
    span_ns: tuple[int, int]

    @property
    def inner(self) -> Stamps:
        """Indices of the nodes between two segments."""
        return np.flatnonzero(self.joined[1:] & self.joined[:-1]) + 1

    @property
    def left_out(self) -> int:
        """Segments that a truth and an IMU without gaps would have had beyond those that are there."""
        length = float(np.median(np.diff(self.t_ns)[self.joined]))
        return max(0, int((self.span_ns[1] - self.span_ns[0]) / length + 1e-3) - int(self.joined.sum()))


def choose_nodes(samples: ImuSamples, truth: Trajectory, segment_s: float) -> Nodes:
    """The poses nearest to a regular grid; a segment is left out where truth or IMU has a gap.

    Raises:
        LabelError: fewer than `FEWEST` nodes lie between two segments.
    """
    begin, end = coverage(samples)
    inside = truth[(truth.t_ns >= begin) & (truth.t_ns <= end)]
    if len(inside) < 2:
        raise LabelError(f"truth and IMU do not overlap: IMU {begin}..{end} ns, {len(truth)} poses")
    span = int(inside.t_ns[0]), int(inside.t_ns[-1])
    step = round(segment_s * 1e9)
    grid = np.arange(span[0], span[1] + 1, step, dtype=np.int64)
    after = np.clip(np.searchsorted(inside.t_ns, grid), 1, len(inside) - 1)
    nearer = grid - inside.t_ns[after - 1] < inside.t_ns[after] - grid
    nearest = np.where(nearer, after - 1, after)
    nodes = inside[np.unique(nearest[np.abs(inside.t_ns[nearest] - grid) <= 0.25 * step])]
    lengths = np.diff(nodes.t_ns)
    regular = (lengths >= 0.5 * step) & (lengths <= 1.5 * step)
    chosen = Nodes(nodes.t_ns, nodes.R_WB, nodes.p_WB, regular & ~_gaps(samples, nodes.t_ns), span)
    if len(chosen.inner) < FEWEST:
        raise LabelError(
            f"{int(chosen.joined.sum())} segments of {segment_s:g} s without a gap in truth or IMU in "
            f"{(span[1] - span[0]) * 1e-9:.1f} s; at least {FEWEST} nodes between two of them are needed"
        )
    return chosen


def _gaps(samples: ImuSamples, t_ns: Stamps) -> Mask:
    """(N - 1,) whether the IMU says nothing for longer than `MAX_GAP_S` somewhere between two nodes."""
    ends = np.flatnonzero(np.diff(samples.t_ns) > MAX_GAP_S * 1e9)
    gap: Mask = np.zeros(len(t_ns) - 1, dtype=bool)
    for k in ends:
        gap |= (t_ns[:-1] < samples.t_ns[k + 1]) & (t_ns[1:] > samples.t_ns[k])
    return gap

"""Runs of the filter over simulated flights, for tests."""

from dataclasses import replace

import numpy as np

from msckf.config import FilterConfig
from msckf.filter import Filter
from navcore.imu import ImuSamples
from navcore.odometry import Run, run
from navcore.sequence import Sequence


def fly(sequence: Sequence, prior=None, **settings) -> Run:
    """The filter over a recording; settings by dotted name with two underscores for the dot."""
    overrides = {name.replace("__", "."): value for name, value in settings.items()}
    return run(Filter(sequence.calibration, FilterConfig().with_overrides(overrides), prior), sequence)


def states(result: Run):
    """Everything that a run estimated, as one array to compare bit by bit: (M, 21)."""
    rows = [
        np.concatenate([s.R_WB.ravel(), s.p_WB, s.v_WB, s.b_g, s.b_a])
        for s in (e.state for e in result.estimates if e.state is not None)
    ]
    return np.array(rows)


def seconds(sequence: Sequence, result: Run):
    """(N,) seconds of each estimate from the first frame."""
    return (np.array([e.t_ns for e in result.estimates]) - sequence.frames[0].t_ns) * 1e-9


def without_imu(sequence: Sequence, start_s: float, end_s: float) -> Sequence:
    """The recording with an IMU gap, in seconds from the first frame."""
    t = (sequence.imu.t_ns - sequence.frames[0].t_ns) * 1e-9
    keep = (t < start_s) | (t > end_s)
    imu = sequence.imu
    return replace(sequence, imu=ImuSamples(imu.t_ns[keep], imu.gyro[keep], imu.accel[keep]))

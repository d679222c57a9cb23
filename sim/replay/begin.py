"""A first path to smooth from: truth's poses, held together by the gyro."""

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps
from navcore.errors import DataError
from navcore.trajectory import Trajectory
from sim.replay.knots import Intervals, Knots

_STEADY = 9  # poses over which a flipped one is seen
_FLIP = np.deg2rad(5.0)


def first_knots(truth: Trajectory, intervals: Intervals) -> Knots:
    """States near enough for Gauss-Newton.

    The gyro is integrated over the whole span; what truth's attitude turns against it changes slowly, so that
    poses that stand out are left out, and gaps can be bridged.

    Raises:
        DataError: no pose agrees with its neighbours.
    """
    b_g = _gyro_bias(truth, intervals)
    R_GB = _integrated(intervals.imu.gyro - b_g, intervals.h)
    k, tau = intervals.locate(truth.t_ns)
    at_truth = R_GB[k] @ so3.exp((intervals.imu.gyro[k] - b_g) * tau[:, None])
    R_WG = truth.R_WB @ np.swapaxes(at_truth, 1, 2)
    steady = _steady(R_WG)
    if steady.sum() < 2:
        raise DataError(f"truth's attitude and the gyro have nothing in common ({len(truth)} poses)")
    drift = Slerp(_seconds(truth.t_ns[steady], intervals), Rotation.from_matrix(R_WG[steady]))
    t = _seconds(intervals.t_ns, intervals)
    R_WB = drift(np.clip(t, drift.times[0], drift.times[-1])).as_matrix() @ R_GB
    p_WB = truth[steady].at(intervals.t_ns).p_WB
    v_WB = np.gradient(p_WB, t, axis=0)
    return Knots(R_WB, p_WB, v_WB, np.tile(b_g, (len(t), 1)), np.zeros((len(t), 3)))


def _gyro_bias(truth: Trajectory, intervals: Intervals) -> Floats:
    """(3,) rad/s: median of what the gyro says more than truth's turns."""
    turned = np.zeros((len(intervals.t_ns), 3))
    turned[1:] = np.cumsum(intervals.imu.gyro * intervals.h[:, None], axis=0)
    t, s = _seconds(intervals.t_ns, intervals), _seconds(truth.t_ns, intervals)
    by_gyro = np.stack([np.interp(s, t, turned[:, axis]) for axis in range(3)], axis=1)
    R_WB = truth.R_WB
    by_truth = so3.log(np.swapaxes(R_WB[:-1], 1, 2) @ R_WB[1:])
    bias: Floats = np.median((np.diff(by_gyro, axis=0) - by_truth) / np.diff(s)[:, None], axis=0)
    return bias


def _integrated(rate: Floats, h: Floats) -> Rotations:
    steps = Rotation.from_matrix(so3.exp(rate * h[:, None]))
    R = [Rotation.identity()]
    for step in steps:
        R.append(R[-1] * step)
    matrices: Rotations = Rotation.concatenate(R).as_matrix()
    return matrices


def _steady(R_WG: Rotations) -> Mask:
    """(M,) whether each rotation is near the median of those around it."""
    x = so3.to_quaternion(R_WG)
    x = x * np.sign(np.sum(x * x[len(x) // 2], axis=1, keepdims=True))
    padded = np.pad(x, ((_STEADY // 2, _STEADY // 2), (0, 0)), mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(padded, _STEADY, axis=0), axis=-1)
    away = so3.log(np.swapaxes(so3.from_quaternion(middle), 1, 2) @ R_WG)
    return np.asarray(np.linalg.norm(away, axis=1) < _FLIP)


def _seconds(t_ns: Stamps, intervals: Intervals) -> Floats:
    seconds: Floats = (t_ns - intervals.t_ns[0]) * 1e-9
    return seconds

"""One label from a recording and its truth."""

from dataclasses import dataclass

import numpy as np

from ipnet.errors import ConfigError, LabelError
from ipnet.preintegration import coverage, preintegrate
from ipnet.recordings import Label
from navcore import so3
from navcore.imu import GRAVITY
from navcore.sequence import Sequence


@dataclass(frozen=True)
class LabelConfig:
    """Settings of a label."""

    segment_s: float = 1.0  # time between two poses of the truth that the IMU is held against

    def __post_init__(self) -> None:
        if not (np.isfinite(self.segment_s) and self.segment_s > 0.0):
            raise ConfigError(f"segment_s is {self.segment_s}, expected a positive number")


def label(sequence: Sequence, config: LabelConfig = LabelConfig()) -> Label:
    """The bias of a recording.

    Raises:
        LabelError: it has no truth, or too little.
    """
    truth = sequence.truth
    if truth is None:
        raise LabelError(f"{sequence.name}: has no truth")
    begin, end = coverage(sequence.imu)
    begin, end = max(begin, int(truth.t_ns[0])), min(end, int(truth.t_ns[-1]))
    nodes = np.arange(begin, end, round(config.segment_s * 1e9), dtype=np.int64)
    if len(nodes) < 10:
        raise LabelError(f"{sequence.name}: truth and IMU share {(end - begin) * 1e-9:.1f} s")
    at = truth.at(nodes)
    R, p, T = at.R_WB, at.p_WB, np.diff(nodes) * 1e-9
    good = truth.covers(nodes)
    segment = good[1:] & good[:-1]
    pair = segment[1:] & segment[:-1]
    bias = np.zeros(6)
    g_W = np.array([0.0, 0.0, -GRAVITY])
    for _ in range(5):
        inc = preintegrate(sequence.imu, nodes, bias[:3], bias[3:])
        r_R = so3.log(np.swapaxes(inc.delta_R, 1, 2) @ np.swapaxes(R[:-1], 1, 2) @ R[1:])
        r_p = np.diff(p, axis=0) / T[:, None] - 0.5 * g_W * T[:, None]
        dp = np.einsum("nij,nj->ni", R[:-1], inc.delta_p) / T[:, None]
        dv = np.einsum("nij,nj->ni", R[:-1], inc.delta_v)
        r_a = np.diff(r_p, axis=0) - g_W * T[:-1, None] - (dv[:-1] - dp[:-1] + dp[1:])
        J_p, J_v = R[:-1] @ inc.J[:, 6:9] / T[:, None, None], R[:-1] @ inc.J[:, 3:6]
        J_a = J_v[:-1] - J_p[:-1] + J_p[1:]
        A = np.concatenate([inc.J[segment, :3].reshape(-1, 6), J_a[pair].reshape(-1, 6)])
        r = np.concatenate([r_R[segment].ravel(), r_a[pair].ravel()])
        step = np.linalg.lstsq(A, r, rcond=None)[0]
        bias = bias + step
    left = r - A @ step
    covariance = np.linalg.inv(A.T @ A) * left.var()
    return Label(sequence.name, bias, covariance)

"""What truth and preintegrated IMU say of the biases, as linear equations in W.

Yi et al., "A Plug-and-Play Learning-based IMU Bias Factor for Robust Visual-Inertial Odometry", "IMU bias
estimation for training label": preintegrated terms are held against those of the truth, to first order in the
biases. Theirs of position and velocity need the truth's velocity. Here velocities are eliminated: with q the mean
velocity of a segment, the step from one segment's q to the next is the integral of specific force and gravity under
a triangle that rises over the one and falls over the other. So positions alone are enough.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from ipnet.labels.nodes import Nodes
from ipnet.preintegration import Increments
from navcore import so3
from navcore.arrays import Floats, Stamps, Vectors
from navcore.imu import GRAVITY

OFFSET_UNIT_S = 0.01
"""The time offset is solved for in this unit, so that all unknowns are of one size."""

OFFSET_SIGMA, LEVEL_SIGMA = 10.0, 0.86
"""What may be expected: .1 s, in the unit above; and x, y of gravity [m/s^2], five degrees. A body that never turns
cannot tell gravity from a bias; it is then said to be no surer than this."""


@dataclass(frozen=True)
class Equations:
    """r = A x + errors, three rows (x, y, z in W) for each of N moments.

    Attributes:
        A: (N, 3, U) by the unknowns: a bias (3), then what else is solved for.
        r: (N, 3).
        t_s: (N,) s, when, from the start of the span.
        span_s: length of the span.
        by_node: (N, nodes) how an error of the truth at a node enters.
        overlap: (N - 1,) correlation of the IMU's error with that of the next moment.
        by_gyro: (N, 3, 3) by the gyro bias, where that was solved for before.
        prior: (U,) what is known of each unknown beforehand, 1 over its variance about zero.
        bands: by how much each node's variance enters a moment's, and its covariance with the next and the one after.
    """

    A: Floats
    r: Vectors
    t_s: Floats
    span_s: float
    by_node: sparse.csr_array
    overlap: Floats
    by_gyro: Floats | None = None
    prior: Floats = field(default_factory=lambda: np.zeros(3))
    bands: tuple[sparse.csr_array, ...] = field(init=False)

    def __post_init__(self) -> None:
        D, n = self.by_node, len(self.r)
        object.__setattr__(self, "bands", tuple(sparse.csr_array(D[: n - k].multiply(D[k:])) for k in range(3)))


def gyro_equations(nodes: Nodes, increments: Increments) -> Equations:
    """A segment each: its turn by the truth less that by the gyro [rad/s], by b_g."""
    R, k = nodes.R_WB, np.flatnonzero(nodes.joined)
    T = increments.dt[k]
    turned = so3.log(_T(increments.delta_R[k]) @ _T(R[k]) @ R[k + 1])
    r = np.matvec(R[k + 1], turned) / T[:, None]
    A = R[k + 1] @ increments.J[k, 0:3, 0:3] / T[:, None, None]
    rows = np.arange(len(k))
    by_node = _matrix([(rows, k + 1, 1.0 / T), (rows, k, -1.0 / T)], (len(k), len(R)))
    middle = (nodes.t_ns[k] + nodes.t_ns[k + 1]) // 2
    return Equations(A, r, *_when(nodes, middle), by_node, np.zeros(len(k) - 1))


def accel_equations(nodes: Nodes, increments: Increments, tilt: bool, down: float = GRAVITY) -> Equations:
    """A node between two segments each [m/s^2], by b_a, what the truth's positions are early by, and gravity's x, y.

    The second is in `OFFSET_UNIT_S`, the third there only with `tilt`. `down`: what is left of gravity along z.
    """
    p, i = nodes.p_WB, nodes.inner
    R = nodes.R_WB[i]
    T = increments.dt[:, None]
    q = np.diff(p, axis=0) / T  # (N - 1, 3) mean velocity of each segment
    d = 0.5 * (T[i - 1] + T[i])  # area of the triangle
    back = _T(increments.delta_R[i - 1])  # both segments are seen from the node between them: one attitude's error
    late = increments.delta_v - increments.delta_p / T  # under the weight that rises
    J_late = increments.J[:, 3:6] - increments.J[:, 6:9] / T[..., None]
    rising, falling = np.matvec(back, late[i - 1]), increments.delta_p[i] / T[i]
    J = back @ J_late[i - 1] + increments.J[i, 6:9] / T[i, :, None]
    J[:, :, 0:3] += so3.hat(rising) @ increments.J[i - 1, 0:3, 0:3]
    J = R @ J / d[..., None]
    r = (q[i] - q[i - 1]) / d - np.matvec(R, rising + falling) / d - [0.0, 0.0, -down]
    before, after = (
        np.matvec(R @ back, increments.delta_v[i - 1]) / T[i - 1],
        np.matvec(R, increments.delta_v[i]) / T[i],
    )
    jerk = (after - before) / d
    columns = [J[:, :, 3:6], OFFSET_UNIT_S * jerk[..., None]]
    if tilt:
        columns.append(np.broadcast_to(np.eye(3)[:, :2], (len(i), 3, 2)))
    rows, before, after = np.arange(len(i)), 1.0 / (T[i - 1] * d)[:, 0], 1.0 / (T[i] * d)[:, 0]
    by_node = _matrix([(rows, i - 1, before), (rows, i, -before - after), (rows, i + 1, after)], (len(i), len(p)))
    overlap = np.where(np.diff(i) == 1, 0.25, 0.0)  # of two triangles that share a segment
    A = np.concatenate(columns, axis=2)
    sigmas = np.array([OFFSET_SIGMA, LEVEL_SIGMA, LEVEL_SIGMA])[: A.shape[2] - 3]
    prior = np.concatenate([np.zeros(3), sigmas**-2.0])
    return Equations(A, r, *_when(nodes, nodes.t_ns[i]), by_node, overlap, J[:, :, 0:3], prior)


def turn_columns(nodes: Nodes, increments: Increments) -> Floats:
    """(N, 3, 3) what a turn of the truth's body against the IMU [rad] does to `gyro_equations`."""
    k = np.flatnonzero(nodes.joined)
    R = nodes.R_WB
    return R[k + 1] @ (_T(increments.delta_R[k]) - np.eye(3)) / increments.dt[k, None, None]


def _when(nodes: Nodes, t_ns: Stamps) -> tuple[Floats, float]:
    begin, end = nodes.span_ns
    return np.asarray((t_ns - begin) * 1e-9, dtype=np.float64), (end - begin) * 1e-9


def _matrix(entries: list[tuple[Stamps, Stamps, Floats]], shape: tuple[int, int]) -> sparse.csr_array:
    rows, columns, values = (np.concatenate(x) for x in zip(*entries, strict=True))
    return sparse.csr_array((values, (rows, columns)), shape=shape)


def _T(M: Floats) -> Floats:
    return np.swapaxes(M, -1, -2)

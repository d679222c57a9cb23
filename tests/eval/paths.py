"""Paths that the tests of eval compare: a brisk flight, and an estimate that drifts away from it."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from navcore.trajectory import Trajectory


def flight(rng: np.random.Generator, seconds: float = 60.0, rate_hz: float = 20.0) -> Trajectory:
    """A smooth path through random points, its attitude swaying, its biases constant."""
    t = np.arange(0.0, seconds, 1.0 / rate_hz)
    knots = np.arange(0.0, seconds + 4.0, 3.0)
    position = CubicSpline(knots, rng.normal(0.0, 4.0, (len(knots), 3)))
    attitude = CubicSpline(knots, rng.normal(0.0, 0.8, (len(knots), 3)))
    q_WB = Rotation.from_rotvec(attitude(t)).as_quat()
    b_g, b_a = np.tile([0.01, -0.02, 0.03], (len(t), 1)), np.tile([0.1, 0.2, -0.3], (len(t), 1))
    t_ns = 1_400_000_000_000_000_000 + np.round(t * 1e9).astype(np.int64)
    return Trajectory(t_ns, q_WB, position(t), position(t, 1), b_g, b_a)


def drifting(truth: Trajectory, rng: np.random.Generator, sigma: float = 0.01) -> Trajectory:
    """An estimate in its own world (turned by 40 degrees about z, moved), walking off at random."""
    n = len(truth)
    R_VW = Rotation.from_euler("z", 40.0, degrees=True)
    walk = np.cumsum(rng.normal(0.0, sigma, (n, 3)), axis=0)
    turn = Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.1 * sigma, (n, 3)), axis=0))
    q_VB = (R_VW * Rotation.from_quat(truth.q_WB) * turn).as_quat()
    assert truth.v_WB is not None and truth.b_g is not None and truth.b_a is not None
    p_VB = (truth.p_WB + walk) @ R_VW.as_matrix().T + np.array([3.0, -5.0, 2.0])
    b_g = truth.b_g + rng.normal(0.0, 1e-3, (n, 3))
    return Trajectory(truth.t_ns, q_VB, p_VB, truth.v_WB @ R_VW.as_matrix().T, b_g, truth.b_a + 0.02)

"""The smoothed path as a motion that a camera can be moved along."""

import numpy as np

from navcore import so3
from navcore.arrays import Stamps
from sim.motion import Motion
from sim.replay.knots import Intervals, Knots, g_W, second_integral, turned

_STEP_NS = 1_000_000


def motion_along(knots: Knots, intervals: Intervals, start_ns: int, end_ns: int) -> Motion:
    """The path between two stamps on a grid of 1 ms.

    From knot to knot the body turns at a constant rate under a constant specific force: those that take the
    one knot's attitude and velocity to the next one's. What that misses of position (1e-7 m) is spread evenly.
    """
    t_ns: Stamps = np.arange(start_ns, end_ns + 1, _STEP_NS)
    k, seconds = intervals.locate(t_ns)
    h, tau = intervals.h[:, None], seconds[:, None]
    R_BW = np.swapaxes(knots.R_WB[:-1], 1, 2)
    phi = so3.log(R_BW @ knots.R_WB[1:])
    force = turned(so3.left_jacobian_inverse(phi) @ R_BW, np.diff(knots.v_WB, axis=0) / h - g_W)
    whole = turned(knots.R_WB[:-1] @ second_integral(phi), force) + 0.5 * g_W
    missed = np.diff(knots.p_WB, axis=0) - knots.v_WB[:-1] * h - whole * h**2

    part = phi[k] * (tau / h[k])
    R_k = knots.R_WB[k]
    once = turned(R_k @ so3.left_jacobian(part), force[k]) + g_W
    twice = turned(R_k @ second_integral(part), force[k]) + 0.5 * g_W
    p_WB = knots.p_WB[k] + knots.v_WB[k] * tau + twice * tau**2 + missed[k] * (tau / h[k])
    return Motion.from_states(
        _STEP_NS * 1e-9, R_k @ so3.exp(part), p_WB, knots.v_WB[k] + once * tau, start_ns=int(t_ns[0])
    )

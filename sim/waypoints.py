"""A smooth path through random waypoints, with its derivatives: what a platform is asked to follow."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from navcore.arrays import Floats, Vectors


@dataclass(frozen=True)
class Box:
    """An axis-aligned part of the world [m]."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class Reference:
    """The wanted motion at N times: position and its derivatives (N, 3) in W, yaw (N,) rad."""

    p: Vectors
    v: Vectors
    a: Vectors
    yaw: Floats


@dataclass(frozen=True)
class Path:
    """Quintic splines over time for position and yaw: acceleration and jerk are smooth.

    Attributes:
        position: t [s] to (..., 3) m in W.
        yaw: t [s] to rad.
        start_s: before it the path rests at its first point.
    """

    position: BSpline
    yaw: BSpline
    start_s: float

    def sample(self, t_s: Floats) -> Reference:
        """The wanted motion at times (N,)."""
        t = np.maximum(t_s - self.start_s, 0.0)
        return Reference(self.position(t), self.position(t, 1), self.position(t, 2), self.yaw(t))


def random_path(
    box: Box,
    start: Vectors,
    seconds: float,
    speed: float,
    yaw_rate: float,
    rng: np.random.Generator,
    start_s: float = 0.0,
) -> Path:
    """A path from rest at `start` through waypoints drawn in `box`, which it leaves downwards only, a little.

    Args:
        box: where waypoints lie.
        start: (3,) m; may lie below the box.
        seconds: how long the path must last after `start_s`.
        speed: m/s along straight lines between waypoints; mean of the flight.
        yaw_rate: rad/s, sd of the mean yaw rate between waypoints.
        rng: draws waypoints and yaw.
        start_s: rest before.
    """
    low, high = np.array(box.low), np.array(box.high)
    points = [start, start + np.array([0.0, 0.0, max(1.0, low[2] - start[2] + 0.2)])]
    times = [0.0, 2.0 * (points[1][2] - start[2]) / speed]
    while times[-1] < seconds + 5.0 or len(points) < 8:
        step = rng.uniform(low, high) - points[-1]
        distance = float(np.linalg.norm(step))
        if 1.5 <= distance <= 5.0:
            points.append(points[-1] + step)
            times.append(times[-1] + distance / speed)
    t, p = np.array(times), np.array(points)
    yaws = rng.uniform(-np.pi, np.pi) + np.concatenate(
        [[0.0, 0.0], np.cumsum(rng.normal(0.0, yaw_rate, len(t) - 2) * np.diff(t)[1:])]
    )
    rest = ([(1, np.zeros(3)), (2, np.zeros(3))], [(1, np.zeros(3)), (2, np.zeros(3))])
    position = make_interp_spline(t, p, k=5, bc_type=rest)  # type: ignore[arg-type]
    return Path(_kept_inside(position, low, high), make_interp_spline(t, yaws, k=3), start_s)


def _kept_inside(path: BSpline, low: Vectors, high: Vectors) -> BSpline:
    """The path with every axis shrunk so far towards the middle of the box that overshoots stay inside."""
    middle = 0.5 * (low + high)
    p = path(np.linspace(path.t[0], path.t[-1], 4000))
    excess_up = (p - middle).max(axis=0) / (high - middle)
    excess_down = (middle - p).max(axis=0) / (middle - low)
    excess_down[2] = 1.0  # the ground, where the path begins, may lie below
    shrink = 1.0 / np.maximum(1.0, np.maximum(excess_up, excess_down))
    anchor = np.array([middle[0], middle[1], p[0, 2]])
    return BSpline(path.t, anchor + (path.c - anchor) * shrink, path.k)

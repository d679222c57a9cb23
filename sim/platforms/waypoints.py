"""A smooth path through random waypoints, with its derivatives: what a platform is asked to follow."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from navcore.arrays import Floats, Vectors

_LEAST_PACE = 0.4  # of the drawn times: clipping makes the way shorter, so it is flown in less time
_RESTING = 3  # coefficients that fix position, velocity and acceleration at the start


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
    acceleration: float = np.inf,
) -> Path:
    """A path from rest at `start` through waypoints drawn in `box`, which it never leaves once it is in it.

    Args:
        box: where waypoints lie.
        start: (3,) m; may lie below the box.
        seconds: how long the path must last after `start_s`.
        speed: m/s, mean of the path after take-off.
        yaw_rate: rad/s, sd of the mean yaw rate between waypoints.
        rng: draws waypoints and yaw.
        start_s: rest before.
        acceleration: m/s^2, never exceeded; a path that is too wild for it is flown slower.
    """
    low, high = np.array(box.low), np.array(box.high)
    points = [start, start + np.array([0.0, 0.0, max(1.0, low[2] - start[2] + 0.2)])]
    times = [0.0, 3.0 * (points[1][2] - start[2]) / speed]
    while times[-1] < (seconds + 5.0) / _LEAST_PACE:
        step = rng.uniform(low, high) - points[-1]
        distance = float(np.linalg.norm(step))
        if 1.5 <= distance <= 5.0:
            points.append(points[-1] + step)
            times.append(times[-1] + distance / speed)
    t, p = np.array(times), np.array(points)
    rest = ([(1, np.zeros(3)), (2, np.zeros(3))], [(1, np.zeros(3)), (2, np.zeros(3))])
    position = _kept_inside(make_interp_spline(t, p, k=5, bc_type=rest), low, high)  # type: ignore[arg-type]
    pace = max(_mean_speed(position, t[1]) / speed, np.sqrt(_most_acceleration(position) / acceleration), _LEAST_PACE)
    turns = rng.normal(0.0, yaw_rate, len(t) - 2) * pace * np.diff(t)[1:]
    yaws = rng.uniform(-np.pi, np.pi) + np.concatenate([[0.0, 0.0], np.cumsum(turns)])
    yaw = make_interp_spline(pace * t, yaws, k=3)
    return Path(BSpline(pace * position.t, position.c, position.k), yaw, start_s)


def _mean_speed(path: BSpline, after_s: float) -> float:
    t = np.arange(after_s, path.t[-1], 0.02)
    return float(np.linalg.norm(path(t, 1), axis=1).mean())


def _most_acceleration(path: BSpline) -> float:
    return float(np.linalg.norm(path(np.arange(path.t[0], path.t[-1], 0.02), 2), axis=1).max())


def _kept_inside(path: BSpline, low: Vectors, high: Vectors) -> BSpline:
    """The path with its coefficients clipped to the box, but for those that hold the rest at its start.

    A B-spline lies in the convex hull of its coefficients, so overshoots end at the box, as smooth as before.
    """
    c = path.c.copy()
    c[_RESTING:] = np.clip(c[_RESTING:], low, high)
    return BSpline(path.t, c, path.k)

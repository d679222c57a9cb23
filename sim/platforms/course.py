"""A way over the ground, as a person or a driver takes it: towards one goal after another, in curves, with pauses."""

from dataclasses import dataclass
from math import atan2, copysign, cos, hypot, pi, sin, sqrt

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from navcore.arrays import Floats
from sim.errors import ConfigError

_STEP_S = 0.02
_REACHED = 0.5  # m from a goal
_MIDDLE = np.zeros(2)
_STEERING_LAG_S = 0.15  # twice in a row, for curvature and for speed: the course has a continuous jerk
_MOST_PULL = 0.8  # m/s^2, of speeding up and slowing down


@dataclass(frozen=True)
class Going:
    """How one goes."""

    half_area: tuple[float, float]  # m, goals lie in it, about the origin of W; turns lead out of it by a radius
    speed: float  # m/s, sought on the way
    turning_radius: float  # m, the least
    sideways: float  # m/s^2, slower in curves that would ask for more
    pause_share: float  # of the goals at which one stops
    pause_s: tuple[float, float] = (1.0, 4.0)

    def __post_init__(self) -> None:
        if not 0.0 < self.speed <= 4.0:
            raise ConfigError(f"speed is {self.speed} m/s, expected above 0 and at most 4")
        if not 4.0 * self.turning_radius < min(self.half_area) * 2.0:
            raise ConfigError(
                f"circles of {self.turning_radius} m do not fit into an area of half sizes {self.half_area}"
            )


@dataclass(frozen=True)
class Course:
    """Splines over time [s] of the place (x, y) [m], the heading [rad, unwrapped] and the speed [m/s]."""

    place: BSpline
    heading: BSpline
    speed: BSpline
    seconds: float


class _Walker:
    """A point that goes ahead, with a curvature and a speed that follow what is wanted with a lag."""

    def __init__(self, x: float, y: float, heading: float) -> None:
        self.x, self.y, self.heading = x, y, heading
        self.speed = self.curvature = 0.0
        self._speed_sought = self._curvature_sought = 0.0

    def bearing(self, goal: Floats) -> tuple[float, float]:
        """Distance [m], and how far to the left of ahead [rad, within pi]."""
        dx, dy = float(goal[0]) - self.x, float(goal[1]) - self.y
        return hypot(dx, dy), (atan2(dy, dx) - self.heading + pi) % (2.0 * pi) - pi

    def leaves(self, half_area: tuple[float, float]) -> bool:
        """Outside before a turn could begin, and on its way further out."""
        reach = 2.0 * _STEERING_LAG_S * self.speed
        dx, dy = cos(self.heading), sin(self.heading)
        out_x = abs(self.x + reach * dx) > half_area[0] and self.x * dx > 0.0
        return out_x or (abs(self.y + reach * dy) > half_area[1] and self.y * dy > 0.0)

    def way_back(self) -> float:
        """Which way it turns to where it came from: above zero left. Once turned away from it, it turns on."""
        _, left = self.bearing(_MIDDLE)
        return left if abs(left) < 0.75 * pi else self.curvature

    def step(self, speed: float, curvature: float) -> None:
        share = _STEP_S / _STEERING_LAG_S
        pull = max(-_MOST_PULL * _STEP_S, min(_MOST_PULL * _STEP_S, share * (speed - self._speed_sought)))
        self._speed_sought += pull
        self._curvature_sought += share * (curvature - self._curvature_sought)
        self.speed += share * (self._speed_sought - self.speed)
        self.curvature += share * (self._curvature_sought - self.curvature)
        middle = self.heading + 0.5 * _STEP_S * self.speed * self.curvature
        self.x += _STEP_S * self.speed * cos(middle)
        self.y += _STEP_S * self.speed * sin(middle)
        self.heading += _STEP_S * self.speed * self.curvature


def random_course(going: Going, seconds: float, rng: np.random.Generator, rest_s: float = 0.0) -> Course:
    """A course of `seconds`, the first `rest_s` of them at rest, towards goals drawn one after another."""
    half = np.array(going.half_area)
    start, heading = rng.uniform(-half, half), rng.uniform(-pi, pi)
    walker = _Walker(float(start[0]), float(start[1]), float(heading))
    goal = start
    sharpest = 1.0 / going.turning_radius
    waits, pace = rest_s, 1.0
    rows = []
    for _ in range(int(seconds / _STEP_S) + 10):
        rows.append((walker.x, walker.y, walker.heading, walker.speed))
        distance, left = walker.bearing(goal)
        behind = distance < 2.0 * going.turning_radius and abs(left) > 0.45 * pi
        if distance < _REACHED or behind:
            stops = len(rows) > 1 and rng.random() < going.pause_share
            waits += rng.uniform(*going.pause_s) if stops else 0.0
            goal, pace = _next_goal(walker, half, going.turning_radius, rng), rng.uniform(0.75, 1.25)
            distance, left = walker.bearing(goal)
        curvature = max(-sharpest, min(sharpest, 2.0 * sin(left) / distance if abs(left) < 0.5 * pi else 9.0 * left))
        if walker.leaves(going.half_area):
            curvature = copysign(sharpest, walker.way_back())
        curve = max(abs(curvature), abs(walker.curvature), 1e-3)
        speed = min(going.speed * pace, sqrt(going.sideways / curve))
        walker.step(speed if waits <= 0.0 else 0.0, curvature)
        waits = max(0.0, waits - _STEP_S)
    table = np.array(rows)
    t = np.arange(len(table)) * _STEP_S
    place, ahead, speeds = (make_interp_spline(t, table[:, columns], k=5) for columns in ([0, 1], 2, 3))
    return Course(place, ahead, speeds, seconds)


def _next_goal(walker: _Walker, half: Floats, radius: float, rng: np.random.Generator) -> Floats:
    """Somewhere far enough to be turned to."""
    while True:
        goal: Floats = rng.uniform(-half, half)
        distance, left = walker.bearing(goal)
        if distance > 2.0 * radius * (1.0 + abs(left) / pi) and distance > 2.0 * _REACHED:
            return goal

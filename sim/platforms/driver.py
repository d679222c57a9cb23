"""How a car with steered front wheels keeps to a course."""

from dataclasses import dataclass
from math import atan, cos, pi, sin

import numpy as np
from scipy.ndimage import gaussian_filter1d

from sim.platforms.course import Course

_CATCH_UP = 1.5  # 1/s, of the way by which it lags behind
_RETURN = 0.6  # m, in which it comes back to the course
_DAMPING = 1.0
_CRAWL = 0.1  # m/s; slower, curvature cannot be told from the turning, and the wheels go to where they are needed next
_BRAKE = 0.01  # m/s; slower than that is standing
_STEER_S = 0.1  # no hand turns wheels at once


@dataclass(frozen=True)
class Wheelbase:
    """What of a car matters to steering [m]."""

    length: float  # between the axles
    track: float  # between the wheels of an axle
    radius: float  # of a wheel
    turning_radius: float  # the least, of the middle of the rear axle


Wanted = tuple[float, float, float, float, float]
"""x, y [m], heading [rad], speed [m/s], curvature [1/m]."""


def wanted_along(course: Course, period_s: float) -> list[Wanted]:
    """What a course asks for, every `period_s`."""
    t = np.arange(int(course.seconds / period_s) + 2) * period_s
    speed = np.clip(course.speed(t), 0.0, None)
    moving = np.append(np.flatnonzero(speed > _CRAWL), len(t) - 1)
    soon = moving[np.searchsorted(moving, np.arange(len(t)))]
    curvature = (course.heading(t, 1) / np.maximum(speed, _CRAWL))[soon]
    smooth = gaussian_filter1d(curvature, _STEER_S / period_s, mode="nearest")
    table = np.column_stack([course.place(t), course.heading(t), speed, smooth])
    return [(x, y, heading, v, kappa) for x, y, heading, v, kappa in table.tolist()]


def steer(car: Wheelbase, x: float, y: float, heading: float, wanted: Wanted) -> tuple[float, float, float, float]:
    """Angles of the front wheels, left and right [rad], and rates of the rear wheels [rad/s].

    Args:
        car: its measures.
        x, y, heading: where the middle of the rear axle is [m] in W, and where it points [rad].
        wanted: where it should be.
    """
    x_d, y_d, heading_d, v, kappa = wanted
    if v > _BRAKE:  # standing, there is nothing to correct
        c, s = cos(heading_d), sin(heading_d)
        behind = c * (x_d - x) + s * (y_d - y)
        aside = c * (y_d - y) - s * (x_d - x)
        turn = (heading_d - heading + pi) % (2.0 * pi) - pi
        v = max(0.0, v + _CATCH_UP * behind)
        kappa += aside / _RETURN**2 + 2.0 * _DAMPING * turn / _RETURN
    else:
        v = 0.0
    sharpest = 1.0 / car.turning_radius
    kappa = max(-sharpest, min(sharpest, kappa))
    inner = 0.5 * car.track * kappa
    ahead = car.length * kappa
    return (
        atan(ahead / (1.0 - inner)),
        atan(ahead / (1.0 + inner)),
        v * (1.0 - inner) / car.radius,
        v * (1.0 + inner) / car.radius,
    )

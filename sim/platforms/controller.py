"""A geometric tracking controller for a quadrotor.

Lee, Leok, McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)", CDC 2010.

It is called hundreds of times a second: floats cost a fifth of small arrays.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import NamedTuple

from navcore.imu import GRAVITY

Vector = Sequence[float]
"""Of three components."""


class Frame(NamedTuple):
    """The axes of a body in W: the columns of its rotation."""

    x: Vector
    y: Vector
    z: Vector

    @staticmethod
    def of(w: float, x: float, y: float, z: float) -> "Frame":
        """That of a unit quaternion wxyz."""
        return Frame(
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        )

    def inverse_times(self, v: Vector) -> Vector:
        """A vector of W, in this frame."""
        return _dot(self.x, v), _dot(self.y, v), _dot(self.z, v)

    def times(self, v: Vector) -> Vector:
        """A vector of this frame, in W."""
        return _combine(1.0, _combine(v[0], self.x, v[1], self.y), v[2], self.z)


@dataclass(frozen=True)
class Gains:
    """Feedback gains, each per unit of mass or inertia."""

    position: float = 5.0  # 1/s^2
    velocity: float = 3.6  # 1/s
    attitude: float = 110.0  # 1/s^2
    rate: float = 18.0  # 1/s


class GeometricController:
    """Thrust and moment that make a quadrotor follow a wanted position, acceleration and heading."""

    def __init__(self, mass: float, inertia: Vector, period_s: float, gains: Gains | None = None) -> None:
        """For a body of `mass` [kg] and principal `inertia` [kg m^2], called every `period_s`."""
        self._mass = mass
        self._inertia = inertia
        self._period_s = period_s
        self._gains = gains or Gains()
        self._last: Frame | None = None

    def command(
        self,
        body: Frame,
        p: Vector,
        v: Vector,
        omega: Vector,
        p_d: Vector,
        v_d: Vector,
        a_d: Vector,
        heading: Vector,
    ) -> tuple[float, float, float, float]:
        """Thrust [N] along the body's z, and moment [N m] about its centre of mass, in B.

        Eq. (15) and (16) of the paper, with the wanted angular acceleration left out of (16); the wanted
        rate is that of the wanted attitude, from call to call.

        Args:
            body: attitude.
            p, v, omega: m and m/s in W, rad/s in B.
            p_d, v_d, a_d: what is wanted, in W.
            heading: unit vector along which the nose is to point, in W.
        """
        k = self._gains
        ahead, faster = _combine(1.0, p, -1.0, p_d), _combine(1.0, v, -1.0, v_d)
        a = _combine(1.0, _combine(-k.position, ahead, -k.velocity, faster), 1.0, (a_d[0], a_d[1], a_d[2] + GRAVITY))
        wanted = _upright(a, heading)
        last, self._last = self._last or wanted, wanted
        omega_d = _turn(last, wanted, 1.0 / self._period_s)
        e_R = _turn(wanted, body, 1.0)
        e_omega = _combine(1.0, omega, -1.0, body.inverse_times(wanted.times(omega_d)))
        alpha = _combine(-k.attitude, e_R, -k.rate, e_omega)
        momentum = _times(self._inertia, omega)
        x, y, z = _combine(1.0, _times(self._inertia, alpha), 1.0, _cross(omega, momentum))
        return self._mass * _dot(a, body.z), x, y, z


def _upright(a: Vector, heading: Vector) -> Frame:
    """The frame whose z axis is along `a` and whose x axis lies over `heading`."""
    z = _unit(a)
    y = _unit(_cross(z, heading))
    return Frame(_cross(y, z), y, z)


def _turn(a: Frame, b: Frame, scale: float) -> Vector:
    """vee of the skew part of a^T b, scaled."""
    return (
        0.5 * scale * (_dot(a.z, b.y) - _dot(a.y, b.z)),
        0.5 * scale * (_dot(a.x, b.z) - _dot(a.z, b.x)),
        0.5 * scale * (_dot(a.y, b.x) - _dot(a.x, b.y)),
    )


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _times(a: Vector, b: Vector) -> Vector:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _combine(s: float, a: Vector, t: float, b: Vector) -> Vector:
    return s * a[0] + t * b[0], s * a[1] + t * b[1], s * a[2] + t * b[2]


def _unit(a: Vector) -> Vector:
    scale = 1.0 / sqrt(_dot(a, a))
    return a[0] * scale, a[1] * scale, a[2] * scale

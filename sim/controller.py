"""A geometric tracking controller for a quadrotor.

Lee, Leok, McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)", CDC 2010.
"""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Rotations, Vectors
from navcore.imu import GRAVITY


@dataclass(frozen=True)
class Gains:
    """Feedback gains, each per unit of mass or inertia."""

    position: float = 5.0  # 1/s^2
    velocity: float = 3.6  # 1/s
    attitude: float = 110.0  # 1/s^2
    rate: float = 18.0  # 1/s


class GeometricController:
    """Thrust and moment that make a quadrotor follow a wanted position, acceleration and yaw."""

    def __init__(self, mass: float, inertia: Vectors, period_s: float, gains: Gains | None = None) -> None:
        """For a body of `mass` [kg] and principal `inertia` (3,) [kg m^2], called every `period_s`."""
        self._mass = mass
        self._inertia = inertia
        self._period_s = period_s
        self._gains = gains or Gains()
        self._R_d_last: Rotations | None = None

    def command(
        self,
        R: Rotations,
        p: Vectors,
        v: Vectors,
        omega: Vectors,
        p_d: Vectors,
        v_d: Vectors,
        a_d: Vectors,
        yaw_d: float,
    ) -> Floats:
        """(4,): thrust [N] along the body's z and moment [N m] about its centre of mass, in B.

        Eq. (15) and (16) of the paper, with the wanted angular acceleration left out of (16); the wanted
        rate is that of the wanted attitude, from call to call.
        """
        k = self._gains
        a = a_d - k.position * (p - p_d) - k.velocity * (v - v_d)
        a[2] += GRAVITY
        R_d = _attitude(a, yaw_d)
        thrust = self._mass * float(a @ R[:, 2])
        last = R_d if self._R_d_last is None else self._R_d_last
        self._R_d_last = R_d
        omega_d = _vee_of_skew_part(last.T @ R_d) / self._period_s
        E = R_d.T @ R
        e_R = _vee_of_skew_part(E)
        e_omega = omega - E.T @ omega_d
        alpha = -k.attitude * e_R - k.rate * e_omega
        moment = self._inertia * alpha + _cross(omega, self._inertia * omega)
        return np.array([thrust, *moment])


def _attitude(a: Vectors, yaw: float) -> Rotations:
    """The rotation whose z axis is along `a` and whose x axis heads to `yaw` [rad]."""
    z = a / np.sqrt(a @ a)
    y = _cross(z, np.array([np.cos(yaw), np.sin(yaw), 0.0]))
    y /= np.sqrt(y @ y)
    return np.stack([_cross(y, z), y, z], axis=1)


def _vee_of_skew_part(M: Floats) -> Vectors:
    return 0.5 * np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])


def _cross(a: Vectors, b: Vectors) -> Vectors:
    """`np.cross` costs ten times as much on single vectors."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

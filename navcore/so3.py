"""The rotation group SO(3): exponential, logarithm and Jacobians, batched over leading axes.

Formulas: Solà, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics" (2018), appendix B.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from navcore.arrays import Floats, Quaternions, Rotations, Vectors

_SMALL_ANGLE_SQUARED = 1e-6  # below it the Taylor series is exact to rounding
_GENERATORS = np.zeros((3, 3, 3))  # hat(e_0), hat(e_1), hat(e_2)
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _GENERATORS[_i, _k, _j], _GENERATORS[_i, _j, _k] = 1.0, -1.0


def hat(v: Vectors) -> Floats:
    """The skew-symmetric matrices of `v`: (..., 3) to (..., 3, 3), with `hat(v) @ u == cross(v, u)`."""
    v = np.asarray(v, dtype=np.float64)
    return np.asarray(v @ _GENERATORS.reshape(3, 9)).reshape(*v.shape, 3)


def cross(a: Vectors, b: Vectors) -> Vectors:
    """The cross product of (..., 3) and (..., 3), broadcast; several times faster than NumPy's on small arrays."""
    a0, a1, a2 = a[..., 0], a[..., 1], a[..., 2]
    b0, b1, b2 = b[..., 0], b[..., 1], b[..., 2]
    first = np.asarray(a1 * b2 - a2 * b1)
    out = np.empty((*first.shape, 3))
    out[..., 0], out[..., 1], out[..., 2] = first, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return out


def vee(m: Floats) -> Vectors:
    """The inverse of `hat`: (..., 3, 3) skew-symmetric to (..., 3)."""
    return np.stack([m[..., 2, 1], m[..., 0, 2], m[..., 1, 0]], axis=-1)


def _sinc(t: Floats) -> Floats:
    """sin(t) / t."""
    t = np.where(t == 0.0, 1e-30, t)
    return np.asarray(np.sin(t) / t)


def _cosc(t: Floats) -> Floats:
    """(1 - cos t) / t^2."""
    half = _sinc(0.5 * t)
    return np.asarray(0.5 * half * half)


def _cubic(t: Floats) -> Floats:
    """(t - sin t) / t^3, by series where t is small."""
    s = t * t
    small = s < _SMALL_ANGLE_SQUARED
    t = np.where(small, 1.0, t)
    return np.where(small, 1.0 / 6.0 - s / 120.0 + s * s / 5040.0, (t - np.sin(t)) / (t * t * t))


def _angle(phi: Vectors) -> Floats:
    """(..., 1, 1) of rotation vectors (..., 3)."""
    return np.asarray(np.sqrt(np.sum(phi * phi, axis=-1))[..., None, None])


def exp(phi: Vectors) -> Rotations:
    """Rotation matrices of rotation vectors [rad]: (..., 3) to (..., 3, 3). Solà et al. eq. (132)."""
    phi = np.asarray(phi, dtype=np.float64)
    half, K = 0.5 * _angle(phi), hat(phi)
    sinc = _sinc(half)
    return np.eye(3) + (sinc * np.cos(half)) * K + (0.5 * sinc * sinc) * (K @ K)


def log(R: Rotations) -> Vectors:
    """Rotation vectors [rad] of rotation matrices, angle in [0, pi]: (..., 3, 3) to (..., 3)."""
    R = np.asarray(R, dtype=np.float64)
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1])


def right_jacobian(phi: Vectors) -> Floats:
    """J_r with Exp(phi + d) = Exp(phi) Exp(J_r d): (..., 3) to (..., 3, 3). Solà et al. eq. (143)."""
    phi = np.asarray(phi, dtype=np.float64)
    t, K = _angle(phi), hat(phi)
    return np.eye(3) - _cosc(t) * K + _cubic(t) * (K @ K)


def left_jacobian(phi: Vectors) -> Floats:
    """J_l with Exp(phi + d) = Exp(J_l d) Exp(phi): (..., 3) to (..., 3, 3). Solà et al. eq. (145)."""
    return right_jacobian(-np.asarray(phi, dtype=np.float64))


def right_jacobian_inverse(phi: Vectors) -> Floats:
    """The inverse of `right_jacobian`, for angles below 2 pi. Solà et al. eq. (144)."""
    phi = np.asarray(phi, dtype=np.float64)
    s = np.sum(phi * phi, axis=-1)
    small = s < _SMALL_ANGLE_SQUARED
    t2 = np.where(small, 1.0, s)
    half = 0.5 * np.sqrt(t2)
    quadratic = np.where(small, 1.0 / 12.0 + s / 720.0, (1.0 - half / np.tan(half)) / t2)
    K = hat(phi)
    return np.eye(3) + 0.5 * K + quadratic[..., None, None] * (K @ K)


def left_jacobian_inverse(phi: Vectors) -> Floats:
    """The inverse of `left_jacobian`, for angles below 2 pi. Solà et al. eq. (146)."""
    return right_jacobian_inverse(-np.asarray(phi, dtype=np.float64))


def from_quaternion(q: Quaternions) -> Rotations:
    """Rotation matrices of xyzw quaternions, which need not be normalised: (..., 4) to (..., 3, 3)."""
    q = np.asarray(q, dtype=np.float64)
    return Rotation.from_quat(q.reshape(-1, 4)).as_matrix().reshape(*q.shape[:-1], 3, 3)


def to_quaternion(R: Rotations) -> Quaternions:
    """Unit xyzw quaternions, w >= 0, of rotation matrices: (..., 3, 3) to (..., 4)."""
    R = np.asarray(R, dtype=np.float64)
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat(canonical=True).reshape(*R.shape[:-2], 4)


def normalise(R: Rotations) -> Rotations:
    """The rotation nearest to a matrix that rounding has moved off the group, to second order."""
    return 1.5 * R - 0.5 * R @ np.swapaxes(R, -1, -2) @ R

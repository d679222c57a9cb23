"""Camera models: pinhole with radial-tangential or equidistant distortion.

Points are in the camera frame C (z forward), pixels are OpenCV's: the centre of the top-left one is (0, 0).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import cv2
import numpy as np

from navcore.arrays import Floats, Mask, Pixels, Vectors
from navcore.errors import DataError

_FIXED_POINT_STEPS = 16  # of OpenCV, cheap, before the first of Newton
_NEWTON_STEPS = 20
_NEWTON_TOLERANCE = 1e-6  # of normalised coordinates, a step after which the error is about its square
_MIN_DEPTH = 1e-6


@dataclass(frozen=True)
class Camera(ABC):
    """Intrinsics of one camera.

    Attributes:
        width, height: pixels.
        fx, fy, cx, cy: focal lengths and principal point [px].
        distortion: four coefficients of the model.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    model: ClassVar[str]

    def __post_init__(self) -> None:
        if len(self.distortion) != 4:
            raise DataError(f"{self.model} takes 4 distortion coefficients, got {len(self.distortion)}")
        if not (self.width > 0 and self.height > 0 and self.fx > 0.0 and self.fy > 0.0):
            raise DataError(f"camera size and focal lengths must be positive: {self}")

    @property
    def focal(self) -> float:
        """Mean focal length [px]: pixels per radian at the centre."""
        return 0.5 * (self.fx + self.fy)

    @abstractmethod
    def _distort(self, p_CF: Vectors) -> tuple[Floats, Floats]:
        """Distorted normalised coordinates (..., 2) and their Jacobian by the point (..., 2, 3)."""

    @abstractmethod
    def _by_distortion(self, p_CF: Vectors) -> Floats:
        """Derivative (..., 2, 4) of the distorted normalised coordinates by the four coefficients."""

    @abstractmethod
    def _undistort(self, xy: Floats) -> Vectors:
        """Unit bearings (..., 3) of distorted normalised coordinates (..., 2)."""

    @abstractmethod
    def unfolded(self, p_CF: Vectors) -> Mask:
        """Whether the model is one-to-one at these points (..., 3)."""

    def project(self, p_CF: Vectors) -> Pixels:
        """Pixels (..., 2) of points (..., 3) in C [m]. Points that `visible` refuses give finite nonsense."""
        xy, _ = self._distort(np.asarray(p_CF, dtype=np.float64))
        return xy * self._focals + self._centre

    def project_jacobian(self, p_CF: Vectors) -> tuple[Pixels, Floats]:
        """Pixels (..., 2) and their derivative by the point in C, (..., 2, 3) [px/m]."""
        xy, J = self._distort(np.asarray(p_CF, dtype=np.float64))
        return xy * self._focals + self._centre, J * self._focals[:, None]

    @property
    def intrinsics(self) -> Floats:
        """(8,) fx, fy, cx, cy [px] and the four distortion coefficients."""
        return np.array([self.fx, self.fy, self.cx, self.cy, *self.distortion])

    def with_intrinsics(self, intrinsics: Floats) -> "Camera":
        """The camera with other `intrinsics` (8,)."""
        fx, fy, cx, cy, k1, k2, k3, k4 = np.asarray(intrinsics, dtype=np.float64).tolist()
        return replace(self, fx=fx, fy=fy, cx=cx, cy=cy, distortion=(k1, k2, k3, k4))

    def by_intrinsics(self, p_CF: Vectors) -> Floats:
        """Derivative (..., 2, 8) of the pixels of points (..., 3) by `intrinsics`."""
        p_CF = np.asarray(p_CF, dtype=np.float64)
        xy, _ = self._distort(p_CF)
        J = np.zeros((*xy.shape, 8))
        J[..., 0, 0], J[..., 1, 1] = xy[..., 0], xy[..., 1]
        J[..., 0, 2] = J[..., 1, 3] = 1.0
        J[..., 4:] = self._by_distortion(p_CF) * self._focals[:, None]
        return J

    def unproject(self, uv: Pixels) -> Vectors:
        """Unit bearings (..., 3) in C of pixels (..., 2)."""
        return self._undistort((np.asarray(uv, dtype=np.float64) - self._centre) / self._focals)

    def visible(self, p_CF: Vectors) -> Mask:
        """Whether points (..., 3) in C are imaged: in front, inside the picture, where the model holds."""
        p_CF = np.asarray(p_CF, dtype=np.float64)
        uv = self.project(p_CF)
        return self.unfolded(p_CF) & self.inside(uv)

    def inside(self, uv: Pixels, border: float = 0.0) -> Mask:
        """Whether pixels (..., 2) lie within the picture, at least `border` px from its edge."""
        u, v = uv[..., 0], uv[..., 1]
        low = border - 0.5
        inside = (u >= low) & (v >= low) & (u < self.width - 1 - low) & (v < self.height - 1 - low)
        return np.asarray(inside)

    @cached_property
    def _focals(self) -> Floats:
        return np.array([self.fx, self.fy])

    @cached_property
    def _centre(self) -> Floats:
        return np.array([self.cx, self.cy])


@dataclass(frozen=True)
class PinholeRadtan(Camera):
    """Pinhole with radial-tangential distortion (k1, k2, p1, p2), as OpenCV's and Kalibr's `radtan`."""

    model: ClassVar[str] = "pinhole-radtan"

    def _distort(self, p_CF: Vectors) -> tuple[Floats, Floats]:
        z = np.where(np.abs(p_CF[..., 2]) < _MIN_DEPTH, _MIN_DEPTH, p_CF[..., 2])
        x, y = p_CF[..., 0] / z, p_CF[..., 1] / z
        x_d, y_d, xx, xy, yy = self._radtan(x, y)
        J = np.empty((*x.shape, 2, 3))
        J[..., 0, 0], J[..., 1, 1] = xx / z, yy / z
        J[..., 0, 1] = J[..., 1, 0] = xy / z
        J[..., 0, 2] = -(xx * x + xy * y) / z
        J[..., 1, 2] = -(xy * x + yy * y) / z
        distorted = np.empty((*x.shape, 2))
        distorted[..., 0], distorted[..., 1] = x_d, y_d
        return distorted, J

    def _radtan(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """Distorted x and y of undistorted ones, and dx_d/dx, dx_d/dy = dy_d/dx, dy_d/dy."""
        k1, k2, p1, p2 = self.distortion
        xx, yy, xy = x * x, y * y, x * y
        r2 = xx + yy
        radial = 1.0 + r2 * (k1 + k2 * r2)
        slope = 2.0 * k1 + (4.0 * k2) * r2  # d(radial)/dx = slope * x
        p1x, p1y, p2x, p2y = (2.0 * p1) * x, (2.0 * p1) * y, (2.0 * p2) * x, (2.0 * p2) * y
        x_d = x * (radial + p1y + p2x) + p2 * r2
        y_d = y * (radial + p1y + p2x) + p1 * r2
        return (
            x_d,
            y_d,
            radial + slope * xx + p1y + 3.0 * p2x,
            slope * xy + p1x + p2y,
            radial + slope * yy + 3.0 * p1y + p2x,
        )

    def _by_distortion(self, p_CF: Vectors) -> Floats:
        z = np.where(np.abs(p_CF[..., 2]) < _MIN_DEPTH, _MIN_DEPTH, p_CF[..., 2])
        x, y = p_CF[..., 0] / z, p_CF[..., 1] / z
        r2 = x * x + y * y
        J = np.empty((*x.shape, 2, 4))
        J[..., 0, 0], J[..., 1, 0] = x * r2, y * r2
        J[..., 0, 1], J[..., 1, 1] = x * r2 * r2, y * r2 * r2
        J[..., 0, 2], J[..., 1, 2] = 2.0 * x * y, r2 + 2.0 * y * y
        J[..., 0, 3], J[..., 1, 3] = r2 + 2.0 * x * x, 2.0 * x * y
        return J

    def _undistort(self, xy: Floats) -> Vectors:
        x_d, y_d = xy[..., 0].copy(), xy[..., 1].copy()  # contiguous: faster
        x, y = self._nearly_undistorted(xy)
        for _ in range(_NEWTON_STEPS):
            x_now, y_now, xx, xy_, yy = self._radtan(x, y)
            r_x, r_y = x_d - x_now, y_d - y_now
            det = xx * yy - xy_ * xy_
            det = np.where(np.abs(det) < 1e-9, 1e-9, det)
            step_x, step_y = (yy * r_x - xy_ * r_y) / det, (xx * r_y - xy_ * r_x) / det
            length = np.sqrt(step_x * step_x + step_y * step_y)
            shorter = 0.5 / np.maximum(length, 0.5)
            x, y = x + shorter * step_x, y + shorter * step_y
            if length.max(initial=0.0) < _NEWTON_TOLERANCE:
                break
        rays: Vectors = np.empty((*x.shape, 3))
        rays[..., 0], rays[..., 1], rays[..., 2] = x, y, 1.0
        rays /= np.sqrt(x * x + y * y + 1.0)[..., None]
        return rays

    def _nearly_undistorted(self, xy: Floats) -> tuple[Floats, Floats]:
        """Where Newton's method begins."""
        if xy.size == 0:
            return xy[..., 0], xy[..., 1]
        criteria = (cv2.TERM_CRITERIA_COUNT, _FIXED_POINT_STEPS, 0.0)
        distortion = np.array(self.distortion)
        start = cv2.undistortPoints(xy.reshape(-1, 1, 2), np.eye(3), distortion, criteria=criteria).reshape(xy.shape)
        return start[..., 0].copy(), start[..., 1].copy()

    def unfolded(self, p_CF: Vectors) -> Mask:
        """Whether points are in front of the camera, and inside the radius at which the distortion turns back."""
        in_front = p_CF[..., 2] > _MIN_DEPTH
        z = np.where(in_front, p_CF[..., 2], 1.0)
        r2 = np.sum((p_CF[..., :2] / z[..., None]) ** 2, axis=-1)
        return np.asarray(in_front & (r2 < self._max_r2))

    @cached_property
    def _max_r2(self) -> float:
        """Squared radius at which d/dr (r + k1 r^3 + k2 r^5) vanishes; infinite if it never does."""
        k1, k2, _, _ = self.distortion
        roots = np.roots([5.0 * k2, 3.0 * k1, 1.0])
        real = roots[np.isreal(roots)].real
        positive = real[real > 0.0]
        return float(positive.min()) if positive.size else np.inf


@dataclass(frozen=True)
class PinholeEquidistant(Camera):
    """Fisheye with Kannala-Brandt's polynomial (k1..k4), as OpenCV's `fisheye`, Kalibr's `equidistant`."""

    model: ClassVar[str] = "pinhole-equidistant"

    def _polynomial(self, theta: Floats) -> tuple[Floats, Floats]:
        """theta_d and its derivative."""
        k1, k2, k3, k4 = self.distortion
        t2 = theta * theta
        value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
        slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))
        return value, slope

    def _distort(self, p_CF: Vectors) -> tuple[Floats, Floats]:
        x, y, z = p_CF[..., 0], p_CF[..., 1], p_CF[..., 2]
        r2 = x * x + y * y
        r = np.sqrt(r2)
        near = r < 1e-9 * np.abs(z)  # on the axis the model is the plain pinhole
        safe_r = np.where(near, 1.0, r)
        value, slope = self._polynomial(np.arctan2(r, z))
        norm2 = np.maximum(r2 + z * z, _MIN_DEPTH**2)
        safe_z = np.where(np.abs(z) < _MIN_DEPTH, _MIN_DEPTH, z)
        gain = np.where(near, 1.0 / safe_z, value / safe_r)  # theta_d / r
        xy = p_CF[..., :2] * gain[..., None]
        radial = np.where(near, 0.0, (slope * z / norm2 - gain) / np.where(near, 1.0, r2))  # d(gain)/dr / r
        J = np.empty((*xy.shape, 3))
        J[..., 0, 0] = gain + radial * x * x
        J[..., 0, 1] = J[..., 1, 0] = radial * x * y
        J[..., 1, 1] = gain + radial * y * y
        J[..., :, 2] = -p_CF[..., :2] * np.where(near, 1.0 / safe_z**2, slope / norm2)[..., None]
        return xy, J

    def _by_distortion(self, p_CF: Vectors) -> Floats:
        r = np.linalg.norm(p_CF[..., :2], axis=-1)
        theta = np.arctan2(r, p_CF[..., 2])
        direction = p_CF[..., :2] / np.where(r < _MIN_DEPTH, 1.0, r)[..., None]
        powers = theta[..., None] ** np.array([3, 5, 7, 9])
        return np.asarray(direction[..., :, None] * powers[..., None, :])

    def _undistort(self, xy: Floats) -> Vectors:
        theta_d = np.linalg.norm(xy, axis=-1)
        theta = theta_d.copy()
        for _ in range(_NEWTON_STEPS):
            value, slope = self._polynomial(theta)
            step = (theta_d - value) / np.maximum(slope, 0.1)
            theta = np.clip(theta + step, 0.0, np.pi)
            if step.size == 0 or np.abs(step).max() < _NEWTON_TOLERANCE:
                break
        gain = np.where(theta_d < 1e-12, 1.0, np.sin(theta) / np.where(theta_d < 1e-12, 1.0, theta_d))
        return np.concatenate([xy * gain[..., None], np.cos(theta)[..., None]], axis=-1)

    def unfolded(self, p_CF: Vectors) -> Mask:
        """Whether points are within the angle at which the distortion turns back."""
        theta = np.arctan2(np.linalg.norm(p_CF[..., :2], axis=-1), p_CF[..., 2])
        return np.asarray(theta < self._max_theta)

    @cached_property
    def _max_theta(self) -> float:
        """Angle at which theta_d stops growing; pi if it never does."""
        k1, k2, k3, k4 = self.distortion
        roots = np.roots([9.0 * k4, 7.0 * k3, 5.0 * k2, 3.0 * k1, 1.0])
        real = roots[np.isreal(roots)].real
        positive = real[real > 0.0]
        return min(np.pi, float(np.sqrt(positive.min()))) if positive.size else np.pi


MODELS: dict[tuple[str, str], type[Camera]] = {
    ("pinhole", "radial-tangential"): PinholeRadtan,
    ("pinhole", "radtan"): PinholeRadtan,
    ("pinhole", "equidistant"): PinholeEquidistant,
}
"""Camera classes by (camera_model, distortion_model), in EuRoC's and Kalibr's words."""

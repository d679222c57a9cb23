"""Features of a start in motion, seen from a window of poses: points by direction and inverse range.

Residuals live on the tangent plane of each bearing and are brought to pixels by the camera's own derivative there,
once: no lens has to be evaluated again while poses and points move (docs/filter.md, section 6).
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from msckf.bearings import tangents
from msckf.views import Views
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Vectors

_MIN_COSINE = 0.2  # between a bearing and the direction in which its point is predicted
_INVERSE_RANGE = 0.3  # 1/m, of a point that nothing is known of
_INVERSE_RANGE_SIGMA = 1.0  # 1/m, likewise
_MAX_INVERSE_RANGE = 10.0  # 1/m


@dataclass(frozen=True)
class Points:
    """Features as homogeneous points: p_WF = origin + direction / inverse_range.

    Attributes:
        origin: (F, 3) m in W; direction: (F, 3) unit vectors in W; inverse_range: (F,) 1/m.
    """

    origin: Vectors
    direction: Vectors
    inverse_range: Floats

    INVERSE_RANGE_SIGMA: ClassVar[float] = _INVERSE_RANGE_SIGMA

    @property
    def range_residual(self) -> Floats:
        """(F,) 1/m, how far the inverse ranges are below what is expected of a point that nothing is known of."""
        return np.asarray(_INVERSE_RANGE - self.inverse_range)

    @staticmethod
    def triangulated(views: Views, R_WB: Rotations, p_WB: Vectors) -> "Points":
        """Along the ray of each feature's last view, the inverse range that fits the other rays best."""
        R_WC, p_WC = views.camera_poses(R_WB, p_WB)
        rows, last = np.arange(len(views.seen)), views.last
        rays_W = (R_WC @ views.rays[..., None])[..., 0]
        origin, direction = p_WC[last], rays_W[rows, last]
        base = p_WC - origin[:, None]  # direction - rho * base is parallel to the ray
        off = so3.cross(rays_W, direction[:, None])
        by_rho = so3.cross(rays_W, base)
        weight = views.seen.astype(np.float64)
        along = np.einsum("fv,fvi,fvi->f", weight, off, by_rho)
        size = np.einsum("fv,fvi,fvi->f", weight, by_rho, by_rho)
        # one milliradian of noise against the range known beforehand
        w = (1e-3 / _INVERSE_RANGE_SIGMA) ** 2
        rho = (along + w * _INVERSE_RANGE) / (size + w)
        return Points(origin, direction, np.clip(rho, 1e-3, _MAX_INVERSE_RANGE))

    def rows(self, mask: Mask) -> "Points":
        """Only some of them."""
        return Points(self.origin[mask], self.direction[mask], self.inverse_range[mask])

    def moved(self, d: Floats, origin: Vectors) -> "Points":
        """After a step (F, 3): two across the direction, one of the inverse range; seen from other origins (F, 3)."""
        T = tangents(self.direction)
        rho = np.clip(self.inverse_range + d[:, 2], -0.2, _MAX_INVERSE_RANGE)
        direction = self.direction + (T @ d[:, :2, None])[..., 0] + rho[:, None] * (self.origin - origin)
        norm = np.linalg.norm(direction, axis=1)
        return Points(origin, direction / norm[:, None], rho / norm)


@dataclass(frozen=True)
class Sight:
    """Residuals of views and their derivatives, in pixels; zero where not seen.

    Attributes:
        r: (F, V, 2).
        H_x: (F, V, 2, 6) by dtheta, dp of the pose.
        H_f: (F, V, 2, 3) by the point's step.
        behind: (F,) whether a view has the point beside or behind it.
    """

    r: Floats
    H_x: Floats
    H_f: Floats
    behind: Mask

    @staticmethod
    def of(views: Views, R_WB: Rotations, p_WB: Vectors, points: Points, *, by_poses: bool = True) -> "Sight":
        """At poses (K, 3, 3), (K, 3); without derivatives by them if nobody asks."""
        R_WC, p_WC = views.camera_poses(R_WB, p_WB)
        rho = points.inverse_range[:, None, None]
        base = p_WC - points.origin[:, None]  # (F, V, 3)
        q_W = points.direction[:, None] - rho * base
        q = (np.swapaxes(R_WC, -1, -2) @ q_W[..., None])[..., 0]
        depth = np.sum(q * views.rays, axis=-1)
        ahead = depth > _MIN_COSINE * np.linalg.norm(q, axis=-1)
        depth = np.where(ahead, depth, 1.0)[..., None]
        uv = (views.by_bearing @ q[..., None])[..., 0] / depth
        J = views.by_bearing / depth[..., None] - uv[..., None] * views.rays[..., None, :] / depth[..., None]
        J = np.where((ahead & views.seen)[..., None, None], J, 0.0)
        J_W = J @ np.swapaxes(R_WC, -1, -2)  # (F, V, 2, 3)
        H_x = np.zeros((*J.shape[:-1], 0))
        if by_poses:
            R, p = R_WB[views.poses], p_WB[views.poses]
            from_body = points.direction[:, None] - rho * (p - points.origin[:, None])
            H_theta = so3.cross(J_W, from_body[..., None, :]) @ R
            H_x = np.concatenate([H_theta, -rho[..., None] * J_W], axis=-1)
        H_f = np.concatenate([J_W @ tangents(points.direction)[:, None], -(J_W @ base[..., None])], axis=-1)
        return Sight(np.where(ahead[..., None], -uv, 0.0), H_x, H_f, (~ahead & views.seen).any(axis=1))


def last_origins(views: Views, R_WB: Rotations, p_WB: Vectors) -> Vectors:
    """(F, 3) where the camera was when it saw each feature last."""
    return np.asarray(views.camera_poses(R_WB, p_WB)[1][views.last])

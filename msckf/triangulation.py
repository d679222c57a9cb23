"""Positions of many features at once from their views (docs/filter.md, section 4)."""

from dataclasses import dataclass

import numpy as np

from msckf.config import VisionConfig
from msckf.views import Views
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Vectors

_STEPS = 4
_FAR = 1e-3  # 1/m, inverse range given to features without parallax


@dataclass(frozen=True)
class Triangulated:
    """Features in space.

    Attributes:
        p_WF: (F, 3) m.
        valid: (F,) whether the position can be used.
        rms: (F,) px, reprojection error.
        certainty: (F,) inverse range by its standard deviation. Features below `min_parallax` are placed far out along
            their ray, where they speak of rotation only.
    """

    p_WF: Vectors
    valid: Mask
    rms: Floats
    certainty: Floats

    def rows(self, mask: Mask) -> "Triangulated":
        """Only some of the features."""
        return Triangulated(self.p_WF[mask], self.valid[mask], self.rms[mask], self.certainty[mask])


def triangulate(views: Views, R_WB: Rotations, p_WB: Vectors, config: VisionConfig) -> Triangulated:
    """Triangulate from body poses R_WB (K, 3, 3), p_WB (K, 3).

    A feature is x = (across, across, inverse range) from the last view that saw it (Montiel et al. 2006, "Unified
    inverse depth parametrization", eq. 3). Its direction from any view, times the inverse range, is linear in x, so what
    of it lies across the ray that was seen is, too: least squares, with weights by the range that the step before gave
    (Hartley and Sturm 1997, "Triangulation", section 4.2). Nothing needs a first guess or goes astray at infinity.

    A feature without parallax would get a distance made of noise, and pretend to know the translation by it. It is
    put at `_FAR` instead: there it hardly depends on the translation, and what its true distance adds to the residual
    lies in the direction that the projection onto the left null space takes out.
    """
    F = len(views.uv)
    if F == 0:
        return Triangulated(np.zeros((0, 3)), np.zeros(0, dtype=bool), np.zeros(0), np.zeros(0))
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    rays = (R_WC @ views.rays[..., None])[..., 0]  # (F, V, 3) in W
    anchor, rows = views.last, np.arange(F)
    frame = across_and_along(rays[rows, anchor])
    towards = p_WC[anchor][:, None] - p_WC  # (F, V, 3) from every view to the anchor
    focal = np.array([camera.focal for camera in views.rig.cameras])[views.cameras]
    across = _across(rays) * (views.seen * focal)[..., None, None]  # (F, V, 2, 3) px
    A = np.concatenate([across @ frame[:, None, :, :2], across @ towards[..., None]], axis=-1)  # (F, V, 2, 3)
    b = (across @ frame[:, None, :, 2:])[..., 0]  # (F, V, 2)

    x = np.zeros((F, 3))
    h = rays
    scale = np.ones(rays.shape[:2])
    for _ in range(_STEPS):
        J = A / scale[..., None, None]
        r = b / scale[..., None]
        normal = np.einsum("fvia,fvib->fab", J, J)
        normal = normal + np.eye(3) * (1e-12 * np.einsum("faa->f", normal) + 1e-9)[:, None, None]
        x = -np.linalg.solve(normal, np.einsum("fvia,fvi->fa", J, r)[..., None])[..., 0]
        direction = frame[..., 2] + (frame[..., :2] @ x[:, :2, None])[..., 0]
        h = direction[:, None] + x[:, None, 2:] * towards
        scale = np.maximum(np.linalg.norm(h, axis=-1), 1e-3)
    residual = (A @ x[:, None, :, None])[..., 0] + b
    cost = np.sum((residual / scale[..., None]) ** 2, axis=(1, 2))
    sigma = np.sqrt(np.maximum(np.linalg.inv(normal)[:, 2, 2], 1e-18)) * config.pixel_noise

    certainty = x[:, 2] / sigma
    near = certainty > config.min_parallax
    rho = np.where(near, np.maximum(x[:, 2], 1e-9), _FAR)
    p_WF = p_WC[anchor] + direction / rho[:, None]
    distance = np.linalg.norm(p_WF[:, None] - p_WC, axis=-1)
    forward = np.einsum("fvi,fvi->fv", h, rays) > 0.9 * scale
    in_front = (forward & (distance > config.min_depth) | ~views.seen).all(axis=1)
    nearest = np.where(views.seen, distance, np.inf).min(axis=1)
    count = views.seen.sum(axis=1)
    rms = np.sqrt(cost / np.maximum(count, 1.0))
    valid = in_front & (~near | (nearest < config.max_depth)) & np.isfinite(rms) & (count >= 2)
    return Triangulated(np.where(valid[:, None], p_WF, 0.0), valid, np.where(valid, rms, np.inf), certainty)


def across_and_along(rays: Vectors) -> Rotations:
    """Rotations (F, 3, 3) whose last column is the ray (F, 3)."""
    return np.concatenate([np.swapaxes(_across(rays), -1, -2), rays[..., None]], axis=-1)


def _across(rays: Vectors) -> Floats:
    """Two unit vectors (..., 2, 3) at right angles to each other and to unit rays (..., 3)."""
    helper = np.where(np.abs(rays[..., :1]) < 0.7, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    first = so3.cross(helper, rays)
    first /= np.maximum(np.linalg.norm(first, axis=-1, keepdims=True), 1e-12)
    return np.stack([first, so3.cross(rays, first)], axis=-2)

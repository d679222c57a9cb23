"""Positions of many features at once from their views (docs/filter.md, section 4)."""

from dataclasses import dataclass

import numpy as np

from msckf.bearings import across_and_along
from msckf.config import VisionConfig
from msckf.views import Views
from navcore.arrays import Floats, Mask, Rotations, Vectors

_STEPS = 3
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
    inverse depth parametrization", eq. 3). Its direction from any view, times the inverse range, is linear in x, so
    what of it lies across the ray that was seen is, too: least squares, with weights by the range that the step before
    gave (Hartley and Sturm 1997, "Triangulation", section 4.2). Nothing needs a first guess or goes astray at infinity.

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
    V = rays.shape[1]
    linear = np.empty((F, V, 3, 4))  # directions times inverse range: columns by x, and what is left at x = 0
    linear[..., :2], linear[..., 2], linear[..., 3] = frame[:, None, :, :2], towards, frame[:, None, :, 2]
    along = rays[..., None, :] @ linear
    system = (linear - rays[..., None] * along) * (views.seen * focal)[..., None, None]  # px across the rays

    scale = np.ones((F, V))
    for _ in range(_STEPS):
        weighted = (system / scale[..., None, None]).reshape(F, 3 * V, 4)
        gram = np.swapaxes(weighted, -1, -2) @ weighted  # (F, 4, 4)
        diagonal = np.einsum("faa->fa", gram[:, :3, :3])
        diagonal += 1e-12 * diagonal.sum(axis=1)[:, None] + 1e-9
        inverse = np.linalg.inv(gram[:, :3, :3])
        x = -(inverse @ gram[:, :3, 3:])[..., 0]
        direction = frame[..., 2] + (frame[..., :2] @ x[:, :2, None])[..., 0]
        h = direction[:, None] + x[:, None, 2:] * towards
        scale = np.maximum(np.sqrt(np.einsum("fvi,fvi->fv", h, h)), 1e-3)
    residual = (system @ np.append(x, np.ones((F, 1)), axis=1)[:, None, :, None])[..., 0] / scale[..., None]
    cost = np.einsum("fvi,fvi->f", residual, residual)
    sigma = np.sqrt(np.maximum(inverse[:, 2, 2], 1e-18)) * config.pixel_noise

    certainty = x[:, 2] / sigma
    near = certainty > config.min_parallax
    rho = np.where(near, np.maximum(x[:, 2], 1e-9), _FAR)
    p_WF = p_WC[anchor] + direction / rho[:, None]
    distance = scale / rho[:, None]
    forward = np.einsum("fvi,fvi->fv", h, rays) > 0.9 * scale
    in_front = (forward & (distance > config.min_depth) | ~views.seen).all(axis=1)
    nearest = np.where(views.seen, distance, np.inf).min(axis=1)
    count = views.seen.sum(axis=1)
    rms = np.sqrt(cost / np.maximum(count, 1.0))
    valid = in_front & (~near | (nearest < config.max_depth)) & np.isfinite(rms) & (count >= 2)
    return Triangulated(np.where(valid[:, None], p_WF, 0.0), valid, np.where(valid, rms, np.inf), certainty)

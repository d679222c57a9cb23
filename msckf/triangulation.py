"""Positions of many features at once from their views: a linear guess, then refinement (docs/filter.md, section 4)."""

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

    A feature without parallax would get a distance made of noise, and pretend to know the translation by it. It is
    put at `_FAR` instead: there it hardly depends on the translation, and what its true distance adds to the residual
    lies in the direction that the projection onto the left null space takes out.

    The guess minimises the distances to the rays; the refinement is Levenberg-Marquardt on pixel errors in inverse
    depth from the last view that saw the feature (Montiel et al. 2006, "Unified inverse depth parametrization", eq. 3),
    which stays well-behaved for far features.
    """
    F = len(views.uv)
    if F == 0:
        return Triangulated(np.zeros((0, 3)), np.zeros(0, dtype=bool), np.zeros(0), np.zeros(0))
    R_WC, p_WC = views.camera_poses(R_WB, p_WB)
    weight = views.seen.astype(np.float64)
    rays_C = views.rays
    rays_W = (R_WC @ rays_C[..., None])[..., 0]  # (F, K, 3)
    p_WF = _nearest_to_rays(rays_W, p_WC, weight)

    anchor = views.seen.shape[1] - 1 - np.argmax(views.seen[:, ::-1], axis=1)  # last view
    rows = np.arange(F)
    R_WA, p_WA = R_WC[rows, anchor], p_WC[rows, anchor]
    R_CA = np.swapaxes(R_WC, -1, -2) @ R_WA[:, None]
    p_CA = (np.swapaxes(R_WC, -1, -2) @ (p_WA[:, None] - p_WC)[..., None])[..., 0]
    ray_A = rays_C[rows, anchor]
    frame = _ray_frames(ray_A)  # columns: two directions across the ray, the ray
    p_AF = (np.swapaxes(R_WA, -1, -2) @ (p_WF - p_WA)[..., None])[..., 0]
    along = np.einsum("fi,fi->f", ray_A, p_AF)
    range_guess = np.where(along > config.min_depth, along, 5.0)  # behind: start at a middling range
    across = np.einsum("fij,fi->fj", frame, p_AF)[:, :2] / range_guess[:, None]
    across = np.where((along > config.min_depth)[:, None], np.clip(across, -0.2, 0.2), 0.0)
    x = np.concatenate([across, 1.0 / range_guess[:, None]], axis=1)
    x, cost, spread = _refine(views, weight, R_CA @ frame[:, None], p_CA, x)

    certainty = np.abs(x[:, 2]) / (np.sqrt(spread) * config.pixel_noise)
    near = certainty > config.min_parallax
    rho = np.where(near, np.maximum(x[:, 2], 1e-9), _FAR)
    direction = (frame @ np.concatenate([x[:, :2], np.ones((F, 1))], axis=1)[..., None])[..., 0]
    p_WF = p_WA + (R_WA @ (direction / rho[:, None])[..., None])[..., 0]
    to_feature = p_WF[:, None] - p_WC
    distance = np.linalg.norm(to_feature, axis=-1)
    cosine = np.einsum("fki,fki->fk", to_feature, rays_W) / np.maximum(distance, 1e-9)
    in_front = ((cosine > 0.9) & (distance > config.min_depth) | ~views.seen).all(axis=1)
    nearest = np.where(views.seen, distance, np.inf).min(axis=1)
    count = weight.sum(axis=1)
    rms = np.sqrt(cost / np.maximum(count, 1.0))
    valid = in_front & (~near | (nearest < config.max_depth)) & np.isfinite(rms) & (count >= 2)
    return Triangulated(np.where(valid[:, None], p_WF, 0.0), valid, np.where(valid, rms, np.inf), certainty)


def _nearest_to_rays(rays: Vectors, p_WC: Vectors, weight: Floats) -> Vectors:
    """The points nearest to rays (F, K, 3) from p_WC, in least squares."""
    across = np.eye(3) - rays[..., :, None] * rays[..., None, :]
    across = across * weight[..., None, None]
    A = across.sum(axis=1)
    b = (across @ p_WC[..., None]).sum(axis=1)
    A = A + 1e-9 * np.eye(3) * np.maximum(weight.sum(axis=1), 1.0)[:, None, None]
    return np.asarray(np.linalg.solve(A, b)[..., 0])


def _ray_frames(rays: Vectors) -> Rotations:
    """Rotations (F, 3, 3) whose last column is the ray."""
    helper = np.where(np.abs(rays[:, :1]) < 0.7, np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    first = so3.cross(helper, rays)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, so3.cross(rays, first), rays], axis=-1)


def _refine(views: Views, weight: Floats, R_CA: Rotations, p_CA: Vectors, x: Floats) -> tuple[Floats, Floats, Floats]:
    """Levenberg-Marquardt over x = (across, across, inverse range); each feature has its own damping.

    Returns x, the squared error [px^2], and the variance of the inverse range at one pixel of noise.
    """
    damping = np.full(len(x), 1e-4)
    r, J = _residuals(views, weight, R_CA, p_CA, x)
    cost = np.einsum("fki,fki->f", r, r)
    for _ in range(_STEPS):
        A = np.einsum("fkia,fkib->fab", J, J)
        g = np.einsum("fkia,fki->fa", J, r)
        diagonal = np.einsum("faa->fa", A)
        A = A + np.eye(3) * (damping[:, None] * diagonal + 1e-9)[:, None, :]
        trial = x + np.linalg.solve(A, g[..., None])[..., 0]
        trial[:, 2] = np.maximum(trial[:, 2], 1e-4)
        r_new, J_new = _residuals(views, weight, R_CA, p_CA, trial)
        cost_new = np.einsum("fki,fki->f", r_new, r_new)
        better = cost_new < cost
        gain = np.max(np.where(better, (cost - cost_new) / np.maximum(cost, 1e-9), 0.0), initial=0.0)
        x = np.where(better[:, None], trial, x)
        r = np.where(better[:, None, None], r_new, r)
        J = np.where(better[:, None, None, None], J_new, J)
        cost = np.where(better, cost_new, cost)
        damping = np.where(better, damping * 0.1, damping * 10.0)
        if gain < 1e-3 and better.all():
            break
    A = np.einsum("fkia,fkib->fab", J, J)
    A = A + np.eye(3) * (1e-9 * np.einsum("faa->fa", A) + 1e-9)[:, None, :]  # columns may be parallel: no baseline
    return x, cost, np.maximum(np.linalg.inv(A)[:, 2, 2], 1e-12)


def _residuals(views: Views, weight: Floats, R_CA: Rotations, p_CA: Vectors, x: Floats) -> tuple[Floats, Floats]:
    """Pixel residuals (F, K, 2) and derivatives of the prediction by x (F, K, 2, 3)."""
    direction = np.concatenate([x[:, :2], np.ones((len(x), 1))], axis=1)
    # A point times its inverse range: the projection does not see the scale.
    h = (R_CA @ direction[:, None, :, None])[..., 0] + x[:, None, 2:] * p_CA
    uv, J = views.rig.project_jacobian(views.cameras, h)
    by_x = np.concatenate([R_CA[..., :2], p_CA[..., None]], axis=-1)
    return (views.uv - uv) * weight[..., None], (J @ by_x) * weight[..., None, None]

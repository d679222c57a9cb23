"""Outliers told by epipolar geometry, where the rotation between two views is known."""

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Mask, Vectors


def two_point_inliers(rotated: Vectors, bearings: Vectors, threshold: float, pairs: Floats) -> Mask:
    """Features that fit one translation between two views whose rotation is known (two-point RANSAC).

    Args:
        rotated: (N, 3) unit bearings of the first view, turned into the second's frame.
        bearings: (N, 3) unit bearings of the second view.
        threshold: rad, distance of a bearing from its epipolar plane.
        pairs: (M, 2) numbers in [0, 1): the random choices.

    Returns:
        (N,) mask. A feature that hardly moved fits any translation.
    """
    n = len(bearings)
    normals = so3.cross(rotated, bearings)  # |normal| is the parallax angle
    moved = np.linalg.norm(normals, axis=1)
    static = moved < threshold
    candidates = np.flatnonzero(~static)
    if len(candidates) < 3 or static.sum() > 0.9 * n:
        return np.asarray(static if static.sum() > 0.9 * n else np.ones(n, dtype=bool))
    picks = candidates[(pairs * len(candidates)).astype(int)]
    t = so3.cross(normals[picks[:, 0]], normals[picks[:, 1]])
    length = np.linalg.norm(t, axis=1)
    t = t[length > 1e-12] / length[length > 1e-12][:, None]
    if len(t) == 0:
        return np.ones(n, dtype=bool)
    near = _near_plane(t, rotated, normals, threshold)
    inlier = near[np.argmax(near.sum(axis=1))]
    if inlier.sum() >= 3:  # refine the translation over its inliers and judge again
        _, _, Vt = np.linalg.svd(normals[inlier], full_matrices=False)
        refined = _near_plane(Vt[-1:], rotated, normals, threshold)[0]
        if refined.sum() >= inlier.sum():
            inlier = refined
    return np.asarray(inlier | static)


def _near_plane(t: Vectors, rotated: Vectors, normals: Vectors, threshold: float) -> Mask:
    """(M, N) which bearings are within an angle of the plane through the first bearing and each translation (M, 3)."""
    volume, cosine = t @ normals.T, t @ rotated.T
    return np.asarray(volume * volume < threshold**2 * np.maximum(1.0 - cosine * cosine, 1e-12))

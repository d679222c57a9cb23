"""Alignment of an estimate to the truth: the transformation of the world that fits positions best."""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from eval.errors import ScoreError
from navcore import so3
from navcore.arrays import Rotations, Vectors, frozen
from navcore.trajectory import Trajectory

Mode = Literal["yaw", "se3", "none"]
"""`yaw`: position and yaw, what a VIO cannot observe; `se3`: the whole rotation; `none`: as it came."""


@dataclass(frozen=True)
class Alignment:
    """A change of world frame: V is the world of the estimate, W that of the truth.

    Attributes:
        R_WV: (3, 3).
        p_WV: (3,) m.
    """

    R_WV: Rotations
    p_WV: Vectors

    def __post_init__(self) -> None:
        object.__setattr__(self, "R_WV", frozen("R_WV", self.R_WV, np.float64, (3, 3)))
        object.__setattr__(self, "p_WV", frozen("p_WV", self.p_WV, np.float64, (3,)))

    def apply(self, estimate: Trajectory) -> Trajectory:
        """The estimate seen from W; biases belong to the body and stay."""
        q_WB = so3.to_quaternion(self.R_WV @ estimate.R_WB)
        v_WB = None if estimate.v_WB is None else estimate.v_WB @ self.R_WV.T
        return replace(estimate, q_WB=q_WB, p_WB=estimate.p_WB @ self.R_WV.T + self.p_WV, v_WB=v_WB)


def align(p_VB: Vectors, p_WB: Vectors, mode: Mode = "yaw") -> Alignment:
    """The alignment that minimises the sum of |p_WB - R_WV p_VB - p_WV|^2.

    Args:
        p_VB: (N, 3) estimated positions [m].
        p_WB: (N, 3) true positions at the same times [m].
        mode: which rotation is free.

    Raises:
        ScoreError: shapes that differ, no position at all, or an unknown mode.

    Source: Umeyama, "Least-squares estimation of transformation parameters between two point patterns"
    (1991), eq. (40) and (41) without scale; for yaw the same with the rotation held to the vertical.
    """
    if p_VB.shape != p_WB.shape or p_VB.ndim != 2 or p_VB.shape[1] != 3 or len(p_VB) == 0:
        raise ScoreError(f"positions to align have shapes {p_VB.shape} and {p_WB.shape}, expected twice (N, 3), N > 0")
    if mode not in get_args(Mode):
        raise ScoreError(f"alignment {mode!r} is unknown; known are {', '.join(get_args(Mode))}")
    if mode == "none":
        return Alignment(np.eye(3), np.zeros(3))
    mean_V, mean_W = p_VB.mean(axis=0), p_WB.mean(axis=0)
    M = (p_WB - mean_W).T @ (p_VB - mean_V)  # (3, 3), sum of w v^T
    R_WV = _yaw(M) if mode == "yaw" else _rotation(M)
    return Alignment(R_WV, mean_W - R_WV @ mean_V)


def _yaw(M: Rotations) -> Rotations:
    """The rotation about z that maximises trace(R^T M): cos (M_xx + M_yy) + sin (M_yx - M_xy)."""
    yaw = np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1])
    return so3.exp(np.array([0.0, 0.0, yaw]))


def _rotation(M: Rotations) -> Rotations:
    """The rotation that maximises trace(R^T M)."""
    U, _, Vt = np.linalg.svd(M)
    handed = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R: Rotations = U @ handed @ Vt
    return R

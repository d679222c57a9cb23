"""Poses of truth as factors on the knots: how the body was turned, where it was, with robust weights."""

from dataclasses import dataclass

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Stamps, Vectors
from navcore.trajectory import Trajectory
from sim.replay import mounting as m
from sim.replay.chain import SIZE, THETA, Normal, P, V
from sim.replay.knots import Intervals, Knots, g_W, second_integral, turned
from sim.replay.mounting import Mounting

FINEST = 1e-3
"""Errors of truth are never taken to be smaller, rad and m per axis: they are no white noise."""

_FREEDOM = 4.0  # degrees of freedom of the Student-t distribution that errors of truth are taken to have


@dataclass(frozen=True)
class Fixes:
    """One half of truth, attitudes or positions, against the path.

    Attributes:
        k: (M,) the knot before each.
        r: (M, 3) how far truth is from the path, rad in truth's body or m in W.
        by_knot: (M, 3, 15) its Jacobian by the knot before.
        by_constants: (M, 3, 10) by the mounting.
    """

    k: Stamps
    r: Vectors
    by_knot: Floats
    by_constants: Floats

    def weights(self, sd: float) -> Floats:
        """(M,) robust weights, those of Student's t with scale `sd` per axis: 1.75 at none, 0 far away.

        Lange, Little, Taylor, "Robust statistical modeling using the t distribution" (1989), section 3.
        """
        weights: Floats = (_FREEDOM + 3.0) / (_FREEDOM + np.sum((self.r / sd) ** 2, axis=1))
        return weights

    def refit(self, sd: float) -> float:
        """The scale that fits the residuals better than `sd` does: a step of expectation-maximisation."""
        return max(FINEST, float(np.sqrt(np.mean(self.weights(sd) * np.sum(self.r**2, axis=1)) / 3.0)))

    def add(self, normal: Normal, sd: float, share: float = 1.0) -> None:
        """Add them to normal equations, each with its weight, counted as so many independent ones."""
        information = (share * self.weights(sd) / sd**2)[:, None, None]
        weighted = np.swapaxes(self.by_knot, 1, 2) * information
        np.add.at(normal.own, self.k, weighted @ self.by_knot)
        np.add.at(normal.border, self.k, weighted @ self.by_constants)
        np.add.at(normal.g, self.k, -turned(weighted, self.r))
        weighted = np.swapaxes(self.by_constants, 1, 2) * information
        normal.corner += (weighted @ self.by_constants).sum(axis=0)
        normal.g_c -= turned(weighted, self.r).sum(axis=0)


def attitudes(truth: Trajectory, knots: Knots, intervals: Intervals, mounting: Mounting) -> Fixes:
    """Truth's attitudes: `r = Log((R_VW R_WB R_BT)^T R_VT)`."""
    k, tau = intervals.locate(truth.t_ns + round(mounting.turn_offset_s * 1e9))
    rate = intervals.imu.gyro[k] - knots.b_g[k]
    step = so3.exp(rate * tau[:, None])
    R_WT = knots.R_WB[k] @ step @ mounting.R_BT
    R_TW = np.swapaxes(R_WT, 1, 2)
    by_knot, by_constants = np.zeros((len(k), 3, SIZE)), np.zeros((len(k), 3, m.SIZE))
    by_knot[..., THETA] = -mounting.R_BT.T @ np.swapaxes(step, 1, 2)
    by_constants[..., m.TURN_OFFSET] = -(rate @ mounting.R_BT)[..., None]
    by_constants[..., m.TILT] = -R_TW[..., :2]
    by_constants[..., m.TURN] = -np.eye(3)
    return Fixes(k, so3.log(R_TW @ mounting.R_VW.T @ truth.R_WB), by_knot, by_constants)


def positions(truth: Trajectory, knots: Knots, intervals: Intervals, mounting: Mounting) -> Fixes:
    """Truth's positions: `r = R_VW^T p_VT - (p_WB + R_WB p_BT)`."""
    k, seconds = intervals.locate(truth.t_ns + round(mounting.shift_offset_s * 1e9))
    tau = seconds[:, None]
    rate, force = intervals.imu.gyro[k] - knots.b_g[k], intervals.imu.accel[k] - knots.b_a[k]
    step = so3.exp(rate * tau)
    R_WB = knots.R_WB[k] @ step
    twice = turned(knots.R_WB[k] @ second_integral(rate * tau), force) + 0.5 * g_W
    p_WB = knots.p_WB[k] + knots.v_WB[k] * tau + twice * tau**2
    v_WT = knots.v_WB[k] + 2.0 * twice * tau + turned(R_WB, np.cross(rate, mounting.p_BT))
    p_WT = truth.p_WB @ mounting.R_VW
    by_knot, by_constants = np.zeros((len(k), 3, SIZE)), np.zeros((len(k), 3, m.SIZE))
    by_knot[..., THETA] = R_WB @ so3.hat(mounting.p_BT) @ np.swapaxes(step, 1, 2)
    by_knot[..., P] = -np.eye(3)
    by_knot[..., V] = -np.eye(3) * tau[..., None]
    by_constants[..., m.SHIFT_OFFSET] = -v_WT[..., None]
    by_constants[..., m.TILT] = so3.hat(p_WT)[..., :2]
    by_constants[..., m.LEVER] = -R_WB
    return Fixes(k, p_WT - p_WB - turned(R_WB, mounting.p_BT), by_knot, by_constants)

"""Least squares over a chain of states and a few constants: normal equations that are a band with a border."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from navcore.arrays import Floats

SIZE = 15
"""Error state of a knot: dtheta, dp, dv, db_g, db_a."""
THETA, P, V, B_G, B_A = (slice(3 * k, 3 * k + 3) for k in range(5))


@dataclass
class Normal:
    """Normal equations `H x = g` being summed: knots couple to the next one, constants to all.

    Attributes:
        own: (K, 15, 15) blocks of the knots.
        next: (K-1, 15, 15) blocks, row of knot k + 1, column of knot k.
        g: (K, 15).
        border: (K, 15, C) blocks between knots and constants.
        corner: (C, C) of the constants.
        g_c: (C,).
    """

    own: Floats
    next: Floats
    g: Floats
    border: Floats
    corner: Floats
    g_c: Floats

    @staticmethod
    def empty(knots: int, constants: int) -> "Normal":
        """All zero."""
        shapes = [(knots, SIZE, SIZE), (knots - 1, SIZE, SIZE), (knots, SIZE), (knots, SIZE, constants)]
        return Normal(*(np.zeros(s) for s in [*shapes, (constants, constants), (constants,)]))

    def solve(self) -> "Solution":
        """The minimum, and what its covariance needs."""
        K, _, C = self.border.shape
        factor = cholesky_banded(self._band(), overwrite_ab=True, lower=True, check_finite=False)
        right = np.concatenate([self.g[..., None], self.border], axis=2).reshape(K * SIZE, 1 + C)
        solved = cho_solve_banded((factor, True), right, overwrite_b=True, check_finite=False).reshape(K, SIZE, 1 + C)
        free, slope = solved[..., 0], solved[..., 1:]
        schur = self.corner - np.einsum("kia,kib->ab", self.border, slope)
        P_cc = np.linalg.inv(schur)
        constants = P_cc @ (self.g_c - np.einsum("kia,ki->a", self.border, free))
        return Solution(free - slope @ constants, constants, P_cc, slope, factor)

    def _band(self) -> Floats:
        """Lower band (30, 15 K) as LAPACK stores it."""
        K = len(self.own)
        band = np.zeros((2 * SIZE, K, SIZE))
        for c in range(SIZE):
            band[: SIZE - c, :, c] = self.own[:, c:, c].T
            band[SIZE - c : 2 * SIZE - c, :-1, c] = self.next[:, :, c].T
        return band.reshape(2 * SIZE, K * SIZE)


@dataclass(frozen=True)
class Solution:
    """A minimum of normal equations.

    Attributes:
        knots: (K, 15) steps of the knots.
        constants: (C,) steps of the constants.
        P_cc: (C, C) covariance of the constants.
    """

    knots: Floats
    constants: Floats
    P_cc: Floats
    _slope: Floats
    _factor: Floats

    def covariances(self) -> Floats:
        """(K, 15, 15) marginal covariance of every knot.

        With H = L L^T and G = L_{k+1,k} L_kk^-1: `P_k = (L_kk L_kk^T)^-1 + G^T P_{k+1} G`, from the last knot
        to the first. It is the backward pass of a Rauch-Tung-Striebel smoother.
        """
        K = len(self.knots)
        band = self._factor.reshape(2 * SIZE, K, SIZE)
        own, lower = np.zeros((K, SIZE, SIZE)), np.zeros((K, SIZE, SIZE))
        for c in range(SIZE):
            own[:, c:, c] = band[: SIZE - c, :, c].T
            lower[:, :, c] = band[SIZE - c : 2 * SIZE - c, :, c].T
        inverse = np.linalg.inv(own)
        G = lower @ inverse
        P: Floats = np.swapaxes(inverse, 1, 2) @ inverse
        for k in range(K - 2, -1, -1):
            P[k] += G[k].T @ P[k + 1] @ G[k]
        P += self._slope @ self.P_cc @ np.swapaxes(self._slope, 1, 2)
        return P

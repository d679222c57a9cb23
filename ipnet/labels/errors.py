"""How large the errors of IMU and truth are, and what equations then say: least squares with correlated errors.

Three kinds of error make a row of `Equations`: the IMU's, independent from segment to segment; the truth's at each
node, which enters one segment with one sign and the next with the other; and the walk of the bias about its mean.
The first two are found from the residuals, robustly; the third is the calibration's.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize

from ipnet.labels.equations import Equations
from navcore.arrays import Floats, Vectors

USUAL = 2.0
"""An error of more standard deviations counts as one of so many, however large it is."""
_SHARES = (0.02, 0.2, 0.5, 0.8, 0.98)  # of the variance that may be the IMU's: where the search may begin
_LIMITS = ((0.0, 12.0), (-4.0, 12.0))  # logarithms of sizes over the floor
WALK_S = 5.0
"""The walk of a bias is followed down to half periods of this length."""


@dataclass(frozen=True)
class Errors:
    """Errors of N rows and M nodes.

    Attributes:
        sigma: of a row, by IMU.
        node_sigma: of the truth at a node.
        weights, node_weights: (N,), (M,) at most 1: a variance is divided by it.
    """

    sigma: float
    node_sigma: float
    weights: Floats
    node_weights: Floats


@dataclass(frozen=True)
class Normal:
    """Least squares as H x = h.

    Attributes:
        H, h: (U, U), (U,).
        H_gyro: (U, 3) by an error of the gyro bias, if there was one.
    """

    H: Floats
    h: Floats
    H_gyro: Floats | None


def fresh(equations: Equations, x: Floats) -> Errors:
    """A first guess: half of what is left is the IMU's, half the truth's."""
    size = _size(residual(equations, x))
    rows, nodes = equations.by_node.shape
    return Errors(size, size * float(np.sqrt(rows / equations.bands[0].sum())), np.ones(rows), np.ones(nodes))


def residual(equations: Equations, x: Floats) -> Vectors:
    """(N, 3) what is left at x."""
    return np.asarray(equations.r - equations.A @ x)


def normal(equations: Equations, errors: Errors, walk: float) -> Normal:
    """The normal equations under all three kinds of error; `walk`: density of the bias's random walk."""
    factor = _factor(equations, errors.sigma**2, errors.node_sigma**2, errors)
    n, _, u = equations.A.shape
    drift = _drift(equations, walk)  # (N, 3, K)
    parts = [equations.A, drift, equations.r[..., None]]
    if equations.by_gyro is not None:
        parts.append(equations.by_gyro)
    columns = np.concatenate(parts, axis=2).reshape(n, -1)
    solved = cho_solve_banded((factor, True), columns).reshape(n, 3, -1)
    gram = np.einsum("nia,nib->ab", columns.reshape(n, 3, -1), solved)
    k = drift.shape[2]
    inside = gram[u : u + k, u : u + k] + np.eye(k)  # the walk's coefficients have unit variance
    reduced = gram - gram[:, u : u + k] @ np.linalg.solve(inside, gram[u : u + k])
    H_gyro = reduced[:u, u + k + 1 :] if equations.by_gyro is not None else None
    return Normal(reduced[:u, :u] + np.diag(equations.prior), reduced[:u, u + k], H_gyro)


def reweighted(equations: Equations, x: Floats, errors: Errors, walk: float, floor: float) -> Errors:
    """The most likely sizes of the errors that are left at x, given the weights there were; and new weights.

    Args:
        equations, x: what is left is `residual`.
        errors: weights, and the sizes under which the bias's walk is taken out.
        walk: density of the bias's random walk.
        floor: the IMU's errors are at least this large.
    """
    left = residual(equations, x)
    left = left - _drift_left(equations, left, errors, walk)
    per_node = np.sqrt(len(left) / equations.bands[0].sum())  # a node's error that makes a row's of one

    def surprise(logs: Floats) -> float:
        """Minus the logarithm of the likelihood, a row, but for a constant."""
        variance, node_variance = floor**2 * np.exp(2.0 * logs) * [1.0, per_node**2]
        factor = _factor(equations, variance, node_variance, errors)
        square = float(np.sum(left * cho_solve_banded((factor, True), left))) / (3.0 * len(left))
        return 2.0 * float(np.log(factor[0]).mean()) + square

    size, shares = _size(left), np.array(_SHARES)
    guesses = np.log(np.stack([np.sqrt(shares), np.sqrt(1.0 - shares)], axis=1) * size / floor)
    begin = min(np.clip(guesses, *np.transpose(_LIMITS)), key=surprise)
    found = minimize(surprise, begin, bounds=_LIMITS, method="L-BFGS-B", tol=1e-4)
    sigma, node_sigma = floor * np.exp(found.x) * [1.0, per_node]
    solved = cho_solve_banded((_factor(equations, sigma**2, node_sigma**2, errors), True), left)
    of_rows = sigma**2 / errors.weights[:, None] * solved
    of_nodes = node_sigma**2 / errors.node_weights[:, None] * (equations.by_node.T @ solved)
    return Errors(float(sigma), float(node_sigma), _weights(of_rows, sigma), _weights(of_nodes, node_sigma))


def _size(left: Vectors) -> float:
    """Standard deviation per axis, from the median length."""
    return max(float(np.median(np.linalg.norm(left, axis=1))) / 1.538, 1e-9)  # median of chi, 3 degrees of freedom


def _weights(error: Vectors, sigma: float) -> Floats:
    size = np.linalg.norm(error, axis=1) / (np.sqrt(3.0) * sigma)
    return np.asarray(np.minimum(1.0, (USUAL / np.maximum(size, 1e-12)) ** 2))


def _factor(equations: Equations, variance: float, node_variance: float, errors: Errors) -> Floats:
    """Lower banded Cholesky factor of the rows' covariance, the same for each axis."""
    of_nodes = node_variance / errors.node_weights
    n = len(equations.r)
    band = np.zeros((len(equations.bands), n))
    for k, by_node in enumerate(equations.bands):
        band[k, : n - k] = by_node @ of_nodes
    root = np.sqrt(variance / errors.weights)
    band[0] += root**2
    band[1, : n - 1] += equations.overlap * root[1:] * root[:-1]
    return np.asarray(cholesky_banded(band, lower=True))


def _drift(equations: Equations, walk: float) -> Floats:
    """(N, 3, K) columns of a bias's walk about its mean, scaled to coefficients of unit variance.

    A walk less its mean over a span L is a sum of cos(j pi t / L) with variances 2 L (walk / (j pi))^2.
    """
    L = equations.span_s
    j = np.arange(1, max(1, round(L / WALK_S)) + 1)
    waves = np.cos(np.pi * j * equations.t_s[:, None] / L) * (walk * np.sqrt(2.0 * L) / (np.pi * j))  # (N, K)
    columns = equations.A[:, :, :3, None] * waves[:, None, None, :]
    return np.asarray(columns.reshape(len(waves), 3, -1))


def _drift_left(equations: Equations, left: Vectors, errors: Errors, walk: float) -> Vectors:
    """(N, 3) the part of residuals that is the bias's walk."""
    drift = _drift(equations, walk)
    n = len(left)
    factor = _factor(equations, errors.sigma**2, errors.node_sigma**2, errors)
    solved = cho_solve_banded((factor, True), drift.reshape(n, -1)).reshape(drift.shape)
    inside = np.einsum("nia,nib->ab", drift, solved) + np.eye(drift.shape[2])
    return np.asarray(drift @ np.linalg.solve(inside, np.einsum("nia,ni->a", solved, left)))

"""How good statements about biases are: error, coverage, likelihood, with intervals over recordings."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from ipnet.axes import Axes
from navcore.arrays import Floats, Stamps, frozen

STATED = 0.9
"""Probability of the intervals whose coverage is counted."""
_CONFIDENCE = 0.95
_RESAMPLES = 1000


@dataclass(frozen=True)
class Statements:
    """N estimates against the truth, in the IMU's axes.

    Attributes:
        recording: (N,) int64 index of the recording that an estimate is from.
        error: (N, 6) estimate less truth.
        covariance: (N, 6, 6) as stated.
    """

    recording: Stamps
    error: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        n = len(self.recording)
        object.__setattr__(self, "recording", frozen("recording", self.recording, np.int64, (None,)))
        object.__setattr__(self, "error", frozen("error", self.error, np.float64, (n, 6)))
        object.__setattr__(self, "covariance", frozen("covariance", self.covariance, np.float64, (n, 6, 6)))

    @staticmethod
    def of(rows: Iterable[tuple[int, Floats, Floats]]) -> "Statements":
        """From rows of recording, error, covariance."""
        recording, error, covariance = zip(*rows, strict=True)
        return Statements(np.array(recording), np.array(error), np.array(covariance))


@dataclass(frozen=True)
class Figures:
    """Figures of statements, each for G groups of axes.

    Attributes:
        rmse: root mean square error, pooled over statements and the axes of the group.
        low, high: its 95 % interval, by resampling recordings.
        sigma: root mean square of the stated sd.
        coverage: share of the 90 % intervals that hold the truth.
        nll: mean negative log likelihood of one axis, nats.
        count: statements.
    """

    rmse: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    sigma: tuple[float, ...]
    coverage: tuple[float, ...]
    nll: tuple[float, ...]
    count: int


def figures(statements: Statements, axes: Axes, rng: np.random.Generator) -> Figures:
    """The figures of statements in the axes of a frame."""
    error = statements.error @ axes.R6.T
    variance = np.einsum("ij,njk,ik->ni", axes.R6, statements.covariance, axes.R6)
    covered = np.abs(error) < norm.ppf(0.5 + 0.5 * STATED) * np.sqrt(variance)
    nll = 0.5 * (np.log(2.0 * np.pi * variance) + error**2 / variance)
    pool = axes.pooling  # (G, 6)
    square = error**2 @ pool.T  # (N, G)
    low, high = _interval(statements.recording, square, rng)
    return Figures(
        rmse=_tuple(np.sqrt(square.mean(axis=0))),
        low=_tuple(low),
        high=_tuple(high),
        sigma=_tuple(np.sqrt((variance @ pool.T).mean(axis=0))),
        coverage=_tuple((covered @ pool.T).mean(axis=0)),
        nll=_tuple((nll @ pool.T).mean(axis=0)),
        count=len(error),
    )


def _interval(recording: Stamps, square: Floats, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """(G,), (G,): the interval of the root mean square, recordings drawn with replacement."""
    _, index = np.unique(recording, return_inverse=True)
    n = int(index.max()) + 1
    totals = np.zeros((n, square.shape[1]))
    np.add.at(totals, index, square)
    counts = np.bincount(index, minlength=n)
    drawn = rng.integers(n, size=(_RESAMPLES, n))
    rms = np.sqrt(totals[drawn].sum(axis=1) / counts[drawn].sum(axis=1)[:, None])
    low, high = np.quantile(rms, [0.5 - 0.5 * _CONFIDENCE, 0.5 + 0.5 * _CONFIDENCE], axis=0)
    return low, high


def _tuple(values: Floats) -> tuple[float, ...]:
    return tuple(float(x) for x in values)

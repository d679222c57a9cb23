"""How wrong a source is, fitted to its errors on many recordings: what is constant over a run, and what is short-lived.

A random-effects model, by maximum likelihood (EM; Laird, Ware, "Random-effects models for longitudinal data",
Biometrics 1982, section 4): error_ij = c_i + e_ij over windows j of recordings i, with c ~ N(0, constant) and e of
each axis with the variance scale^2 stated + floor^2.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ipnet.errors import ConfigError
from navcore.arrays import Floats, Mask, Stamps, frozen

_ITERATIONS = 500
_TOLERANCE = 1e-4
_PHASES = 4
"""Overlapping windows are thinned to separate ones; with how many different first windows that is done."""
_SHRINKAGE = 12.0
"""Recordings' worth of belief that the axes of `c` are independent: twice their number."""


@dataclass(frozen=True)
class WindowErrors:
    """Errors of a source on one recording, which share the part `c`.

    Attributes:
        recording: its name.
        t_ns: (N,) middle of each window, or the end of a run, increasing.
        error: (N, 6) statement less truth.
        variance: (N, 6) as stated, before calibration.
    """

    recording: str
    t_ns: Stamps
    error: Floats
    variance: Floats

    def __post_init__(self) -> None:
        n = len(self.t_ns)
        object.__setattr__(self, "t_ns", frozen("t_ns", self.t_ns, np.int64, (None,)))
        object.__setattr__(self, "error", frozen("error", self.error, np.float64, (n, 6)))
        object.__setattr__(self, "variance", frozen("variance", self.variance, np.float64, (n, 6)))
        if not (np.isfinite(self.error).all() and (self.variance > 0.0).all()):
            raise ConfigError(f"{self.recording}: errors must be finite and stated variances positive")


@dataclass(frozen=True)
class ErrorModel:
    """What is wrong with a source.

    Attributes:
        constant: (6, 6) covariance of the error that is constant over a run.
        scale: (6,) factor on the stated sd of a window's own error.
        floor: (6,) sd added to that.
    """

    constant: Floats
    scale: Floats
    floor: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "constant", frozen("constant", self.constant, np.float64, (6, 6)))
        object.__setattr__(self, "scale", frozen("scale", self.scale, np.float64, (6,)))
        object.__setattr__(self, "floor", frozen("floor", self.floor, np.float64, (6,)))

    def variance(self, stated: Floats) -> Floats:
        """(..., 6) of a window's own error, from what the source states."""
        variance: Floats = self.scale**2 * stated + self.floor**2
        return variance

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {name: value.tolist() for name, value in vars(self).items()}

    @staticmethod
    def from_dict(content: dict[str, Any]) -> "ErrorModel":
        """From what `as_dict` gave.

        Raises:
            ConfigError: a key is missing or unknown.
            DataError: a shape is wrong.
        """
        expected = set(ErrorModel.__dataclass_fields__)
        if set(content) != expected:
            raise ConfigError(f"an error model has {sorted(content)}, expected {sorted(expected)}")
        return ErrorModel(**{name: np.array(value, dtype=np.float64) for name, value in content.items()})


@dataclass(frozen=True)
class _Series:
    """Thinned windows, padded to one length: S series of W windows; those of one recording share its weight."""

    error: Floats  # (S, W, 6)
    variance: Floats  # (S, W, 6)
    there: Mask  # (S, W)
    weight: Floats  # (S,) adds up to 1 over a recording
    recordings: int


def fit(errors: Iterable[WindowErrors], window_s: float, floors: bool = True) -> ErrorModel:
    """Fit the model to held-out recordings.

    With few recordings the constant part is cautious: correlations between axes are shrunk by n / (n + 12), and
    the whole is enlarged by (n + 2) / n, since a covariance from n recordings is itself uncertain. A constant error
    that is too small to be told from the short-lived one cannot be excluded: the standard error of its variance where
    there is none is added.

    Args:
        errors: those without a window are left out; several of one recording (cut in another way, say) share its
            weight.
        window_s: windows closer than this share their error; 0 where none do.
        floors: without them only `scale` is fitted, where rows are of several statements together: their variances
            scale as one statement's do, floors do not.

    Raises:
        ConfigError: fewer than two recordings with windows.
    """
    series = _thinned([e for e in errors if len(e.t_ns)], window_s)
    n = series.recordings
    constant, slope, offset = _first_guess(series)
    for _ in range(_ITERATIONS):
        mean, rest = _expected(series, constant, slope, offset)
        second = mean[:, :, None] * mean[:, None, :] + rest
        updated = np.einsum("s,sij->ij", series.weight, second) / n * _off_diagonal(n / (n + 1.0))  # never singular
        left = (series.error - mean[:, None]) ** 2 + np.diagonal(rest, axis1=1, axis2=2)[:, None]  # (S, W, 6)
        slope, offset = _variances(series, left, slope, offset, floors)
        sd = np.sqrt(np.diagonal(constant))
        change = np.abs((updated - constant) / np.outer(sd, sd)).max()
        constant = updated
        if change < _TOLERANCE:
            break
    cautious = constant * _off_diagonal(n / (n + _SHRINKAGE)) * (n + 2.0) / n
    cautious += np.diag(np.sqrt(2.0 / n) * _short_lived_in_means(series, slope, offset))
    return ErrorModel(cautious, np.sqrt(slope), np.sqrt(offset))


def _thinned(errors: list[WindowErrors], window_s: float) -> _Series:
    share = Counter(e.recording for e in errors)
    if len(share) < 2:
        raise ConfigError(f"{len(share)} recordings with windows; an error model needs two or more")
    picked: list[tuple[WindowErrors, Stamps, float]] = []
    for e in errors:
        within = int(np.searchsorted(e.t_ns, e.t_ns[0] + _apart_ns(window_s)))
        firsts = np.unique(np.linspace(0, max(within - 1, 0), _PHASES).astype(int))
        weight = 1.0 / len(firsts) / share[e.recording]
        picked += [(e, _separate(e.t_ns, first, window_s), weight) for first in firsts.tolist()]
    longest = max(len(index) for _, index, _ in picked)
    shape = (len(picked), longest, 6)
    error, variance, there = np.zeros(shape), np.ones(shape), np.zeros(shape[:2], dtype=bool)
    for s, (e, index, _) in enumerate(picked):
        error[s, : len(index)], variance[s, : len(index)] = e.error[index], e.variance[index]
        there[s, : len(index)] = True
    return _Series(error, variance, there, np.array([w for _, _, w in picked]), len(share))


def _off_diagonal(factor: float) -> Floats:
    """(6, 6) of ones on the diagonal, a factor elsewhere."""
    return np.full((6, 6), factor) + (1.0 - factor) * np.eye(6)


def _separate(t_ns: Stamps, first: int, window_s: float) -> Stamps:
    """Indices of windows that do not overlap, from the first on."""
    index = [first]
    while (k := int(np.searchsorted(t_ns, t_ns[index[-1]] + _apart_ns(window_s)))) < len(t_ns):
        index.append(k)
    return np.array(index, dtype=np.int64)


def _apart_ns(window_s: float) -> int:
    """By how much the next window is later at least: a window, but for rounding."""
    return max(round(window_s * 1e9) - 1_000_000, 1)


def _first_guess(series: _Series) -> tuple[Floats, Floats, Floats]:
    """Half of the square error each."""
    square = series.error[series.there] ** 2
    slope = 0.5 * (square / series.variance[series.there]).mean(axis=0)
    return np.diag(0.5 * square.mean(axis=0)), slope, np.zeros(6)


def _expected(series: _Series, constant: Floats, slope: Floats, offset: Floats) -> tuple[Floats, Floats]:
    """Mean (S, 6) and covariance (S, 6, 6) of c given a series' errors."""
    precision = series.there[..., None] / (slope * series.variance + offset)  # (S, W, 6)
    information = np.linalg.inv(constant) + precision.sum(axis=1)[:, :, None] * np.eye(6)
    rest = np.linalg.inv(information)
    mean = (rest @ (precision * series.error).sum(axis=1)[..., None])[..., 0]
    return mean, rest


def _short_lived_in_means(series: _Series, slope: Floats, offset: Floats) -> Floats:
    """(6,) variance of a recording's mean error around its c."""
    precision = series.there[..., None] / (slope * series.variance + offset)
    return np.asarray(series.weight @ (1.0 / precision.sum(axis=1)) / series.recordings, dtype=np.float64)


def _variances(series: _Series, left: Floats, slope: Floats, offset: Floats, floors: bool) -> tuple[Floats, Floats]:
    """A step of Fisher scoring for left = slope stated + offset on each axis, neither of them negative."""
    weight = (series.weight[:, None] * series.there)[..., None] / (slope * series.variance + offset) ** 2
    v = series.variance
    vv, v1, one = ((weight * x).sum(axis=(0, 1)) for x in (v * v, v, np.ones_like(v)))  # (6,) each
    lv, l1 = (weight * left * v).sum(axis=(0, 1)), (weight * left).sum(axis=(0, 1))
    det = vv * one - v1 * v1
    apart = (det > 1e-3 * vv * one) & floors  # stated variances differ enough to tell slope from offset
    safe = np.where(apart, det, 1.0)
    a, b = (lv * one - l1 * v1) / safe, (l1 * vv - lv * v1) / safe
    alone, flat = lv / vv, l1 / one  # with only one of the two
    a_new = np.where(~apart | (b < 0.0), alone, np.where(a < 0.0, 0.0, a))
    b_new = np.where(~apart | (b < 0.0), 0.0, np.where(a < 0.0, flat, b))
    return a_new, b_new

"""`ipnet+motion:NAME`: what a network and a motion model say of the same data, as one source.

Both look at the same samples, so their errors are related. Each axis is the weighted mean with the least variance under
that correlation, which was found on recordings that neither was made from; so was the error of the result.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.calibration import ErrorModel, fit
from ipnet.errors import ConfigError
from ipnet.runs import Run, Span, listen
from navcore.arrays import Floats, frozen
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource, load_prior
from navcore.sequence import Sequence

FOLDER = Path(__file__).parent / "joins"
_CAUTION = 0.95
"""Correlations are never believed to be larger: nearly equal statements would get weights beyond reason."""


@dataclass(frozen=True)
class Join:
    """How two sources are joined.

    Attributes:
        specs: of the two.
        correlation: (6,) of their errors, axis by axis.
        errors: of what results, as the weights would have it.
        recordings: by which all this was found.
    """

    specs: tuple[str, str]
    correlation: Floats
    errors: ErrorModel
    recordings: tuple[str, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "correlation", frozen("correlation", self.correlation, np.float64, (6,)))

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**vars(self), "correlation": self.correlation.tolist(), "errors": self.errors.as_dict()}

    @staticmethod
    def from_dict(content: dict[str, Any]) -> "Join":
        """From what `as_dict` gave."""
        first, second = content["specs"]
        errors = ErrorModel.from_dict(content["errors"])
        return Join((first, second), content["correlation"], errors, tuple(content["recordings"]))


class JoinedPrior:
    """The source: whenever one of the two speaks, both are joined as they stand; before the other has spoken, one."""

    def __init__(self, first: BiasPriorSource, second: BiasPriorSource, join: Join) -> None:
        self.window_s = max(first.window_s, second.window_s)
        self.constant_covariance: Floats = join.errors.constant
        self._sources = (first, second)
        self._join = join
        self._said: list[BiasPrior | None] = [None, None]

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        for source in self._sources:
            source.add_imu(samples)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """What both say now, at most once; stamped with the later of the two."""
        spoken = False
        for k, source in enumerate(self._sources):
            for z in source.poll(t_ns):
                total = z.covariance + source.constant_covariance
                self._said[k] = replace(z, covariance=total)
                spoken = True
        return [self._joined()] if spoken else []

    def _joined(self) -> BiasPrior:
        first, second = self._said
        said = [z for z in (first, second) if z is not None]
        if first is not None and second is not None:
            mean, variance = least_variance(first, second, self._join.correlation)
        else:
            mean, variance = said[0].vector, np.diagonal(said[0].covariance)
        covariance = np.diag(self._join.errors.variance(variance))
        return BiasPrior(max(z.t_ns for z in said), mean[:3], mean[3:], covariance)


def least_variance(first: BiasPrior, second: BiasPrior, correlation: Floats) -> tuple[Floats, Floats]:
    """(6,) the mean of both, weighted so that its variance (6,) is least; neither gets a negative weight."""
    a, b = np.diagonal(first.covariance), np.diagonal(second.covariance)
    shared = np.clip(correlation, -_CAUTION, _CAUTION) * np.sqrt(a * b)
    w = np.clip((b - shared) / (a + b - 2.0 * shared), 0.0, 1.0)  # of the first
    mean: Floats = w * first.vector + (1.0 - w) * second.vector
    variance: Floats = w**2 * a + 2.0 * w * (1.0 - w) * shared + (1.0 - w) ** 2 * b
    return mean, variance


def find_join(specs: tuple[str, str], spans: Iterable[Span]) -> Join:
    """Find how two sources are joined, on spans of recordings that neither was made from.

    Raises:
        ConfigError: fewer than two spans in which both speak.
    """
    spans = list(spans)
    pairs = [_pairs(*(listen(load_prior(spec, span.sequence), span) for spec in specs)) for span in spans]
    if sum(len(p) > 0 for p in pairs) < 2:
        raise ConfigError(f"{' and '.join(specs)} speak together in fewer than two of {len(spans)} runs")
    errors = np.vstack([p for p in pairs if len(p)])  # (N, 2, 6) in units of what is stated
    correlation = (errors[:, 0] * errors[:, 1]).mean(axis=0) / np.sqrt((errors**2).mean(axis=0).prod(axis=0))
    plain = Join(specs, correlation, ErrorModel(1e-12 * np.eye(6), np.ones(6), np.zeros(6)), ())
    heard = [listen(joined(plain, span.sequence), span) for span in spans]
    found = [replace(run.errors, recording=f"{run.span.recording} {k}") for k, run in enumerate(heard)]
    names = tuple(dict.fromkeys(span.recording for span in spans))
    return replace(plain, errors=fit(found, heard[0].window_s), recordings=names)


def joined(join: Join, sequence: Sequence | None) -> JoinedPrior:
    """The source that a join describes."""
    first, second = (load_prior(spec, sequence) for spec in join.specs)
    return JoinedPrior(first, second, join)


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the join of that name, or in that file.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    for path in (FOLDER / f"{argument}.json", Path(argument)):
        if argument and path.is_file():
            return joined(Join.from_dict(json.loads(path.read_text(encoding="utf-8"))), sequence)
    known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.json"))) or "none"
    raise ConfigError(f"ipnet+motion {argument!r} is unknown; known are {known}, or a file that `join` wrote")


def _pairs(first: Run, second: Run) -> Floats:
    """(N, 2, 6) errors over stated sd, of each statement of the first and the second's latest that ended before it."""
    if not first.measurements or not second.measurements:
        return np.zeros((0, 2, 6))
    scaled = []
    for run in (first, second):
        constant = np.diagonal(run.constant_covariance)
        scaled.append(run.errors.error / np.sqrt(run.errors.variance + constant))
    latest = np.searchsorted(second.errors.t_ns, first.errors.t_ns, side="right") - 1
    there = latest >= 0
    return np.stack([scaled[0][there], scaled[1][latest[there]]], axis=1)

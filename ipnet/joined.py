"""`ipnet+motion:NAME`: what a network and a motion model say of the same data, as one source.

Both look at the same samples, so their errors are related in a way that nobody knows. Covariance intersection (Julier,
Uhlmann, "A non-divergent estimation algorithm in the presence of unknown correlations", ACC 1997, eq. 4) needs not know
it: P^-1 = w A^-1 + (1 - w) B^-1 is consistent for every correlation. As a stream: each statement of the first source is
told with its covariance divided by w, each of the second with its divided by 1 - w. w, and a factor on all covariances
(below 1 where the errors are less related than could be), are found on recordings that neither source was made from.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.errors import ConfigError
from ipnet.fusion import nothing_known
from ipnet.runs import Run, Span, listen
from navcore.arrays import Floats
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource, load_prior
from navcore.sequence import Sequence

FOLDER = Path(__file__).parent / "joins"
_SHARES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95)
_FACTORS = tuple(2.0 ** (0.5 * k) for k in range(-4, 9))
_TINY = 1e-16  # (1e-8 rad/s)^2: a constant error of exactly zero has no inverse


@dataclass(frozen=True)
class Join:
    """How two sources are joined.

    Attributes:
        specs: of the two.
        share: w, the weight of the first, above 0 and below 1.
        factor: on all covariances.
        recordings: by which these were found.
    """

    specs: tuple[str, str]
    share: float
    factor: float
    recordings: tuple[str, ...]

    def __post_init__(self) -> None:
        if not (0.0 < self.share < 1.0 and self.factor > 0.0):
            raise ConfigError(f"share {self.share}, factor {self.factor}; expected 0 < share < 1 and a positive factor")

    @property
    def weights(self) -> tuple[float, float]:
        """Of the two."""
        return self.share, 1.0 - self.share

    def constant(self, first: Floats, second: Floats) -> Floats:
        """(6, 6) covariance of what is constantly wrong with both, from that of each."""
        parts = [w * np.linalg.inv(c + _TINY * np.eye(6)) for w, c in zip(self.weights, (first, second), strict=True)]
        joined = self.factor * np.linalg.inv(parts[0] + parts[1])
        return np.asarray(0.5 * (joined + joined.T), dtype=np.float64)

    def told(self, z: BiasPrior, which: int, own: Floats, constant: Floats) -> BiasPrior:
        """A statement of one of the two, with the short-lived part of its error in the joined source.

        Args:
            z: the statement.
            which: 0 or 1.
            own: (6, 6) of that source's constant error.
            constant: (6, 6) of the joined source's.
        """
        rest = self.factor / self.weights[which] * (z.covariance + own) - constant
        values, axes = np.linalg.eigh(rest)  # never negative but for rounding: inversion turns order around
        covariance = (axes * np.maximum(values, 1e-6 * values.max())) @ axes.T
        return replace(z, covariance=0.5 * (covariance + covariance.T))

    @staticmethod
    def from_dict(content: dict[str, Any]) -> "Join":
        """From what JSON made of `asdict`.

        Raises:
            ConfigError: a key is missing or unknown.
        """
        expected = set(Join.__dataclass_fields__)
        if set(content) != expected:
            raise ConfigError(f"a join has {sorted(content)}, expected {sorted(expected)}")
        first, second = content["specs"]
        return Join((first, second), content["share"], content["factor"], tuple(content["recordings"]))


class JoinedPrior:
    """The source: each of the two speaks when it does, and counts for its share.

    All its statements count (`window_s` is 0): which ones share data, their own sources have accounted for.
    """

    def __init__(self, first: BiasPriorSource, second: BiasPriorSource, join: Join) -> None:
        self.window_s = 0.0
        self.constant_covariance: Floats = join.constant(first.constant_covariance, second.constant_covariance)
        self._sources = (first, second)
        self._join = join
        self._last_ns: int | None = None

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        for source in self._sources:
            source.add_imu(samples)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """What both have to say now; a stamp is never before that of a statement that was given earlier."""
        ready = [
            self._join.told(z, which, source.constant_covariance, self.constant_covariance)
            for which, source in enumerate(self._sources)
            for z in source.poll(t_ns)
        ]
        return [self._in_order(z) for z in sorted(ready, key=lambda z: z.t_ns)]

    def _in_order(self, z: BiasPrior) -> BiasPrior:
        stamp = z.t_ns if self._last_ns is None else max(z.t_ns, self._last_ns + 1)
        self._last_ns = stamp
        return replace(z, t_ns=stamp)


def find_join(specs: tuple[str, str], spans: Iterable[Span]) -> Join:
    """The share and the factor under which the estimates at the ends of spans are most likely.

    Args:
        specs: of the two sources.
        spans: of recordings that neither was made from.

    Raises:
        ConfigError: fewer than two spans in which both speak.
    """
    heard = [tuple(listen(load_prior(spec, span.sequence), span) for spec in specs) for span in spans]
    both = [(a, b) for a, b in heard if a.measurements and b.measurements]
    if len(both) < 2:
        raise ConfigError(f"{' and '.join(specs)} speak together in {len(both)} of {len(heard)} runs; expected two")
    names = tuple(dict.fromkeys(a.span.recording for a, _ in both))
    joins = [Join(specs, share, factor, names) for share, factor in product(_SHARES, _FACTORS)]
    return max(joins, key=lambda join: sum(_log_likelihood(join, a, b) for a, b in both))


def _log_likelihood(join: Join, first: Run, second: Run) -> float:
    """Of the true biases at the end of a span."""
    constant = join.constant(first.constant_covariance, second.constant_covariance)
    told = [
        join.told(z, which, run.constant_covariance, constant)
        for which, run in enumerate((first, second))
        for z in run.measurements
    ]
    span = first.span
    together = Run(span, tuple(sorted(told, key=lambda z: z.t_ns)), None, 0.0, constant)
    end = together.fused(nothing_known(span.begin_ns))
    error = end.vector - span.bias_at(np.array([span.end_ns]))[0]
    sign, size = np.linalg.slogdet(end.covariance)
    return float(-0.5 * (size + error @ np.linalg.solve(end.covariance, error))) if sign > 0 else -np.inf


def joined(join: Join, sequence: Sequence | None) -> JoinedPrior:
    """The source that a join describes."""
    first, second = (load_prior(spec, sequence) for spec in join.specs)
    return JoinedPrior(first, second, join)


def write(join: Join) -> str:
    """A join as JSON."""
    return json.dumps(asdict(join), indent=1) + "\n"


def find(argument: str) -> Join:
    """The shipped join of that name, or the one in that file.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    for path in (FOLDER / f"{argument}.json", Path(argument)):
        if argument and path.is_file():
            return Join.from_dict(json.loads(path.read_text(encoding="utf-8")))
    known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.json"))) or "none"
    raise ConfigError(f"ipnet+motion {argument!r} is unknown; known are {known}, or a file that `join` wrote")


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the join of that name, or in that file.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    return joined(find(argument), sequence)

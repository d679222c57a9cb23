"""`ipnet+motion:NAME`: what a network and a motion model say of the same data, as one source.

Both look at the same samples, so their errors are related in a way that nobody knows; added up as if they were not,
they would be surer than they may be. So each axis is taken from one of them: the one under which truth is more likely
on recordings that neither was trained on.
"""

import json
from collections.abc import Iterable
from collections.abc import Sequence as ListLike
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.axes import axes_of
from ipnet.directions import along_first, for_both
from ipnet.errors import ConfigError
from ipnet.fusion import SPREAD, nothing_known
from ipnet.runs import Run, Span, listen
from navcore.arrays import Floats, Mask
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource, load_prior
from navcore.sequence import Sequence

FOLDER = Path(__file__).parent / "joins"
PREFIX = "ipnet+motion:"
_SILENT = 100.0 * np.repeat(SPREAD, 3)
"""Sd of a statement on an axis of which it does not speak [rad/s, m/s^2]: a hundred times the spread of biases."""


@dataclass(frozen=True)
class Join:
    """How two sources are joined.

    Attributes:
        specs: of the two.
        force: (3,) direction of the platform's mean specific force, in B.
        sources: which of the two (0 or 1) speaks of the gyroscope along that force, across it, of the accelerometer
            along, across.
        recordings: by which that was chosen.
    """

    specs: tuple[str, str]
    force: tuple[float, float, float]
    sources: tuple[int, int, int, int]
    recordings: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.specs) != 2 or any(spec.startswith(PREFIX) for spec in self.specs):
            raise ConfigError(f"{self.specs} are to be joined, expected two sources that are not joined ones")
        if len(self.sources) != 4 or {*self.sources} - {0, 1}:
            raise ConfigError(f"sources are {self.sources}, expected four times 0 or 1")
        if not 0.0 < float(np.linalg.norm(self.force)) < np.inf:
            raise ConfigError(f"the force is along {self.force}, expected three numbers that are not all zero")

    @property
    def _R6(self) -> Floats:
        """(6, 6) from B to axes along and across the force."""
        force = np.array(self.force)
        return for_both(along_first(force / np.linalg.norm(force)))

    def speaks(self, which: int) -> Mask:
        """(6,) whether one of the two speaks of each axis along and across the force."""
        return np.asarray(np.repeat(self.sources, [1, 2, 1, 2]) == which, dtype=np.bool_)

    def constant(self, covariances: ListLike[Floats]) -> Floats:
        """(6, 6) covariance of what is constantly wrong on each axis, from the (6, 6) of both."""
        R6 = self._R6
        said = [np.outer(self.speaks(k), self.speaks(k)) for k in (0, 1)]
        joined = sum(mask * (R6 @ c @ R6.T) for mask, c in zip(said, covariances, strict=True))
        return _symmetric(R6.T @ joined @ R6)

    def told(self, z: BiasPrior, which: int) -> BiasPrior:
        """A statement of one of the two, as far as it speaks."""
        R6, said = self._R6, self.speaks(which)
        own = np.outer(said, said) * (R6 @ z.covariance @ R6.T)
        return replace(z, covariance=_symmetric(R6.T @ (own + np.diag(np.where(said, 0.0, _SILENT**2))) @ R6))

    @staticmethod
    def from_dict(content: dict[str, Any]) -> "Join":
        """From what JSON made of `asdict`.

        Raises:
            ConfigError: a key is missing or unknown, or a value is not of its kind.
        """
        expected = set(Join.__dataclass_fields__)
        if not isinstance(content, dict) or set(content) != expected:
            raise ConfigError(f"a join has {sorted(content)}, expected {sorted(expected)}")
        return Join(**{name: tuple(value) for name, value in content.items()})


def _symmetric(covariance: Floats) -> Floats:
    return np.asarray(0.5 * (covariance + covariance.T), dtype=np.float64)


class JoinedPrior:
    """The source: each of the two speaks when it does, of its axes.

    All its statements count (`window_s` is 0): which ones share data, their own sources have accounted for.
    """

    def __init__(self, first: BiasPriorSource, second: BiasPriorSource, join: Join) -> None:
        self.window_s = 0.0
        self.constant_covariance = join.constant([first.constant_covariance, second.constant_covariance])
        self._sources = [(k, source) for k, source in enumerate((first, second)) if join.speaks(k).any()]
        self._join = join
        self._last_ns: int | None = None

    def device(self) -> BiasPrior | None:
        """Nothing is known of a device."""
        return None

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        for _, source in self._sources:
            source.add_imu(samples)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """What both have to say now; a stamp is never before that of a statement that was given earlier."""
        ready = [self._join.told(z, k) for k, source in self._sources for z in source.poll(t_ns)]
        return [self._in_order(z) for z in sorted(ready, key=lambda z: z.t_ns)]

    def _in_order(self, z: BiasPrior) -> BiasPrior:
        stamp = z.t_ns if self._last_ns is None else max(z.t_ns, self._last_ns + 1)
        self._last_ns = stamp
        return replace(z, t_ns=stamp)


def find_join(specs: tuple[str, str], spans: ListLike[Span]) -> Join:
    """Each axis from the source under which the truth at the ends of spans is more likely.

    Args:
        specs: of the two sources.
        spans: of recordings that neither was trained on.

    Raises:
        ConfigError: fewer than two spans, or one of the sources is a joined one or unknown.
    """
    if len(spans) < 2:
        raise ConfigError(f"{len(spans)} runs to choose by, expected two or more")
    axes = axes_of("thrust", spans)
    likely = np.zeros((2, len(axes.groups)))
    for span in spans:
        for k, spec in enumerate(specs):
            likely[k] += _log_likelihood(listen(load_prior(spec, span.sequence), span), axes.R6, axes.groups)
    x, y, z = axes.R_FB[0].tolist()
    gyro_along, gyro_across, accel_along, accel_across = np.argmax(likely, axis=0).tolist()
    names = tuple(dict.fromkeys(span.recording for span in spans))
    return Join(specs, (x, y, z), (gyro_along, gyro_across, accel_along, accel_across), names)


def _log_likelihood(run: Run, R6: Floats, groups: Iterable[tuple[int, ...]]) -> Floats:
    """(4,) of the true biases at the end of a run, a group of axes each."""
    end = run.fused(nothing_known(run.span.begin_ns))
    error, covariance = R6 @ (end.vector - run.span.bias[-1]), R6 @ end.covariance @ R6.T
    found = []
    for group in groups:
        own = np.ix_(group, group)
        nees = error[list(group)] @ np.linalg.solve(covariance[own], error[list(group)])
        found.append(-0.5 * (nees + np.linalg.slogdet(covariance[own])[1]))
    return np.array(found)


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
            try:
                return Join.from_dict(json.loads(path.read_text(encoding="utf-8")))
            except (ValueError, TypeError) as error:
                raise ConfigError(f"{path}: not a join as `python -m ipnet join` writes it: {error}") from error
    known = ", ".join(sorted(p.stem for p in FOLDER.glob("*.json"))) or "none"
    raise ConfigError(f"ipnet+motion {argument!r} is unknown; known are {known}, or a file that `join` wrote")


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """The source with the join of that name, or in that file.

    Raises:
        ConfigError: there is none; the message lists the names.
    """
    return joined(find(argument), sequence)

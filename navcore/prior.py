"""What an estimator can be told about IMU biases, apart from vision.

Two things are kept apart: the device's own history, and what motion reveals. `device` is known before the rig
moves and becomes the initial bias with its covariance. `poll` gives measurements `z = b + c + e`: `c` is what
is wrong with the source on this run and never averages out, `e` is short-lived. Sources are entry points of
the group `navcore.bias_priors`.
"""

import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Literal, Protocol

import numpy as np

from navcore.arrays import Floats, Vectors, frozen
from navcore.errors import ConfigError, DataError
from navcore.imu import ImuSamples
from navcore.sequence import Sequence

GROUP = "navcore.bias_priors"
PriorMode = Literal["modelled", "plain"]


@dataclass(frozen=True)
class BiasPrior:
    """One statement about the biases.

    Attributes:
        t_ns: when the biases were what it says: for a mean the middle of its window, for a smoother the end.
        b_g: (3,) rad/s in B.
        b_a: (3,) m/s^2 in B.
        covariance: (6, 6) of (b_g, b_a); for a measurement the short-lived part `e` only.
    """

    t_ns: int
    b_g: Vectors
    b_a: Vectors
    covariance: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "b_g", frozen("b_g", self.b_g, np.float64, (3,)))
        object.__setattr__(self, "b_a", frozen("b_a", self.b_a, np.float64, (3,)))
        covariance = frozen("covariance", self.covariance, np.float64, (6, 6))
        object.__setattr__(self, "covariance", covariance)
        if not (np.isfinite(self.vector).all() and np.isfinite(covariance).all()):
            raise DataError(f"bias prior at {self.t_ns} ns is not finite: {self.vector}")
        if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance).min() <= 0.0:
            raise DataError(f"covariance of the bias prior at {self.t_ns} ns is not positive definite")

    @property
    def vector(self) -> Floats:
        """(6,) b_g, b_a."""
        return np.concatenate([self.b_g, self.b_a])


@dataclass(frozen=True)
class PriorState:
    """What an estimator knows of its bias prior.

    Attributes:
        applied: measurements that were applied.
        nis: normalised innovation squared of the last of them, before weighting; six are expected. None without one.
        c: (6,) the prior's constant error, of b_g [rad/s] and b_a [m/s^2]; covariance: (6, 6) of it; None where it is
            not estimated.
        with_biases: (6, 6) covariance of c (rows) with the biases (columns), likewise.
        latest: the last measurement that counted, before a start too.
    """

    applied: int
    nis: float | None
    c: Floats | None = None
    covariance: Floats | None = None
    with_biases: Floats | None = None
    latest: "BiasPrior | None" = None


class BiasPriorSource(Protocol):
    """Where priors come from. Causal: `poll` may use only the samples that were added."""

    window_s: float
    """Length of the IMU window behind one measurement [s]; measurements closer than this share noise, and an estimator
    takes only one of them. Less, if each covariance is stated so large that all may be taken: times the overlap."""

    constant_covariance: Floats
    """(6, 6) covariance of `c`, the error that is constant over a run; zero if the source has none."""

    def device(self) -> BiasPrior | None:
        """What is known of this device before it moves, or None."""
        ...

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        ...

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The measurements that became available up to IMU time `t_ns`, each given once, in time order."""
        ...


class Paced:
    """A source that gets its samples when the frames come to them, however far ahead they are fed.

    Args:
        source: which.
        thinned: whether of measurements that share samples only the first counts, one a window.
    """

    def __init__(self, source: BiasPriorSource, *, thinned: bool) -> None:
        self.source = source
        self.latest: BiasPrior | None = None  # of all that counted
        self._thinned = thinned
        self._waiting: deque[ImuSamples] = deque()

    def add_imu(self, samples: ImuSamples) -> None:
        """Take samples, in time order."""
        self._waiting.append(samples)

    def said(self, t_ns: int) -> list[BiasPrior]:
        """What the source says of the samples up to `t_ns`, as far as it counts."""
        self.feed(t_ns)
        kept = []
        for z in self.source.poll(t_ns):
            apart = self.latest is None or z.t_ns - self.latest.t_ns >= self.source.window_s * 1e9 - 1e6
            if apart or not self._thinned:
                self.latest = z
                kept.append(z)
        return kept

    def feed(self, t_ns: int) -> None:
        """Let the source have the samples up to `t_ns`."""
        for samples in self.taken(t_ns):
            self.source.add_imu(samples)

    def taken(self, t_ns: int) -> list[ImuSamples]:
        """The samples up to `t_ns`, which wait no longer."""
        out = []
        while self._waiting:
            samples = self._waiting.popleft()
            upto = int(np.searchsorted(samples.t_ns, t_ns, side="right"))
            if upto:
                out.append(samples if upto == len(samples) else samples[:upto])
            if upto < len(samples):
                self._waiting.appendleft(samples[upto:])
                break
        return out

    def waiting(self) -> tuple[ImuSamples, ...]:
        """The samples that the source has not got yet."""
        return tuple(self._waiting)


PriorFactory = Callable[[str, Sequence | None], BiasPriorSource]
"""Makes a source from the text behind the colon and the recording it is for (None in live use)."""


class Joined:
    """What is known of the device from one source, what its motion reveals from another.

    The two are independent, so an estimator joins them by Bayes' rule, as it does with one source that knows both.
    """

    def __init__(self, device: BiasPriorSource, motion: BiasPriorSource) -> None:
        self.window_s = motion.window_s
        self.constant_covariance = motion.constant_covariance
        self._device, self._motion = device, motion

    def device(self) -> BiasPrior | None:
        """What is known of this device before it moves."""
        return self._device.device()

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        self._motion.add_imu(samples)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The measurements that became available up to IMU time `t_ns`, each given once, in time order."""
        return self._motion.poll(t_ns)


def load_prior(spec: str, sequence: Sequence | None = None) -> BiasPriorSource:
    """The source that `spec` names: `NAME` or `NAME:ARGUMENT`, as `none` or `constant:device.json`.

    Two, separated by a comma, are joined if just one of them knows the device: `constant:device.json,truth`.

    Raises:
        ConfigError: a name is unknown, and the message lists the known ones; or the sources cannot be joined.
    """
    sources = [_load(part, sequence) for part in split_prior(spec)]
    if len(sources) == 1:
        return sources[0]
    devices = [source for source in sources if source.device() is not None]
    motions = [source for source in sources if source.device() is None]
    if len(devices) != 1 or len(motions) != 1:
        raise ConfigError(
            f"bias prior {spec!r} joins {len(devices)} sources that know the device and {len(motions)} that do not;"
            " expected one of each, as constant:FILE.json,NAME"
        )
    return Joined(devices[0], motions[0])


def split_prior(spec: str) -> tuple[str, ...]:
    """The sources that a specification joins. A comma separates two if the name of a source follows it."""
    names = "|".join(re.escape(name) for name in _known())
    return tuple(re.split(rf",(?=(?:{names})(?:[:,]|$))", spec))


def prior_entry(name: str) -> EntryPoint:
    """The entry point behind a source's name.

    Raises:
        ConfigError: the name is unknown; the message lists the known ones.
    """
    known = _known()
    if name not in known:
        raise ConfigError(f"bias prior {name!r} is unknown; known are {', '.join(sorted(known))}")
    return known[name]


def _load(part: str, sequence: Sequence | None) -> BiasPriorSource:
    name, _, argument = part.partition(":")
    factory: PriorFactory = prior_entry(name).load()
    return factory(argument, sequence)


def _known() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}

"""Runs of bias prior sources over recordings, as a live system would make them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ipnet.calibration import WindowErrors
from ipnet.errors import ConfigError
from ipnet.fusion import Fusion
from ipnet.recordings import Recording
from navcore.arrays import Floats, Stamps
from navcore.calibration import Calibration
from navcore.imu import ImuNoise, ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource, load_prior
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory

_CHUNK_S = 0.5
"""Samples are given to a source in pieces of this length, and it is asked after each."""


@dataclass(frozen=True)
class Span:
    """A part of a recording that counts as a run of its own.

    Attributes:
        recording: its name; parts of one recording are not independent of each other.
        sequence: IMU and truth of the part.
        t_ns: (N,) times of `bias`, one a second.
        bias: (N, 6) true b_g, b_a.
    """

    recording: str
    sequence: Sequence
    t_ns: Stamps
    bias: Floats

    @property
    def begin_ns(self) -> int:
        """Of the first sample."""
        return int(self.sequence.imu.t_ns[0])

    @property
    def end_ns(self) -> int:
        """Of the last sample."""
        return int(self.sequence.imu.t_ns[-1])

    @property
    def noise(self) -> ImuNoise:
        """Of the IMU."""
        return self.sequence.calibration.imu

    def bias_at(self, t_ns: Stamps) -> Floats:
        """(M, 6) true b_g, b_a."""
        t = (np.asarray(t_ns) - self.begin_ns) * 1e-9
        known = (self.t_ns - self.begin_ns) * 1e-9
        return np.stack([np.interp(t, known, self.bias[:, k]) for k in range(6)], axis=1)

    def with_offset(self, offset: Floats) -> "Span":
        """The same with (6,) b_g, b_a added to what the IMU says and to the truth."""
        imu = self.sequence.imu
        moved = ImuSamples(imu.t_ns, imu.gyro + offset[:3], imu.accel + offset[3:])
        truth = self.sequence.truth
        if truth is not None and truth.b_g is not None and truth.b_a is not None:
            truth = replace(truth, b_g=truth.b_g + offset[:3], b_a=truth.b_a + offset[3:])
        return Span(self.recording, replace(self.sequence, imu=moved, truth=truth), self.t_ns, self.bias + offset)


@dataclass(frozen=True)
class Run:
    """What a source said over a span.

    Attributes:
        measurements: all of them.
        device: what it knows of the device beforehand, or None.
        window_s, constant_covariance: of the source.
    """

    span: Span
    measurements: tuple[BiasPrior, ...]
    device: BiasPrior | None
    window_s: float
    constant_covariance: Floats

    @property
    def errors(self) -> WindowErrors:
        """Of the measurements, and the variances that they state."""
        t_ns = np.array([z.t_ns for z in self.measurements], dtype=np.int64)
        said = np.array([z.vector for z in self.measurements]).reshape(-1, 6)
        variance = np.array([np.diagonal(z.covariance) for z in self.measurements]).reshape(-1, 6)
        return WindowErrors(self.span.recording, t_ns, said - self.span.bias_at(t_ns), variance)

    def fused(self, start: BiasPrior) -> BiasPrior:
        """The estimate at the end of the span from a start and all measurements."""
        span = self.span
        fusion = Fusion(replace(start, t_ns=span.begin_ns), self.constant_covariance, self.window_s, span.noise)
        for measurement in self.measurements:
            fusion.add(measurement)
        return fusion.at(span.end_ns)


def cut(recordings: Iterable[Recording], seconds: float | None = None, skip: float = 0.0) -> list[Span]:
    """The spans of recordings: each as a whole, or in parts of equal length; what is left at an end is dropped.

    Args:
        seconds: length of a part.
        skip: seconds at each recording's beginning that are left out.

    Raises:
        ConfigError: a length that is not positive, a negative `skip`, or no recording that is long enough.
    """
    if (seconds is not None and not seconds > 0.0) or not skip >= 0.0:
        raise ConfigError(f"spans of {seconds} s after {skip} s; expected a positive length, and 0 or more to skip")
    spans = [span for recording in recordings for span in _spans(recording, seconds, skip)]
    if not spans:
        raise ConfigError(f"no recording is {skip} + {seconds or 0.0} s long")
    return spans


def run(spec: str, span: Span) -> Run:
    """Run the source that `spec` names over a span.

    Raises:
        ConfigError: the source is unknown, or cannot be had for this recording.
    """
    return listen(load_prior(spec, span.sequence), span)


def silent(span: Span) -> Run:
    """The run of a source that says nothing."""
    return Run(span, (), None, 0.0, np.zeros((6, 6)))


def listen(source: BiasPriorSource, span: Span) -> Run:
    """Give a source, which is new, the samples of a span as they come, and keep what it says."""
    measurements = []
    for chunk in _chunks(span.sequence.imu):
        source.add_imu(chunk)
        measurements += source.poll(int(chunk.t_ns[-1]))
    return Run(span, tuple(measurements), source.device(), source.window_s, source.constant_covariance)


def _spans(recording: Recording, seconds: float | None, skip: float) -> Iterator[Span]:
    imu = recording.imu
    first, last = int(imu.t_ns[0]) + round(skip * 1e9), int(imu.t_ns[-1])
    if first >= last:
        return
    length = last + 1 - first if seconds is None else round(seconds * 1e9)
    # A recording of exactly n spans ends one sample early.
    slack = 2 * int(np.median(np.diff(imu.t_ns)))
    for begin in range(first, last + slack - length + 1, length):
        part = imu.between(begin, begin + length)
        t_ns = np.unique(np.append(np.arange(part.t_ns[0], part.t_ns[-1], 1_000_000_000), part.t_ns[-1]))
        truth = _within(recording.truth, begin, begin + length)
        sequence = Sequence(recording.name, Calibration(recording.noise), part, (), truth)
        yield Span(recording.name, sequence, t_ns, recording.bias_at(t_ns))


def _within(truth: Trajectory | None, begin: int, end: int) -> Trajectory | None:
    part = truth.between(begin, end) if truth is not None else None
    return part if part is not None and len(part) else None


def _chunks(imu: ImuSamples) -> Iterator[ImuSamples]:
    seconds = (imu.t_ns - imu.t_ns[0]) * 1e-9
    cuts = np.searchsorted(seconds, np.arange(0.0, seconds[-1] + _CHUNK_S, _CHUNK_S))
    for begin, end in zip(cuts[:-1], [*cuts[1:-1], len(imu)], strict=True):
        if end > begin:
            yield imu[int(begin) : int(end)]

"""Scores of bias prior sources against known biases: of single measurements, and of estimates over whole runs."""

from collections.abc import Callable
from collections.abc import Sequence as ListLike
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ipnet.axes import Axes, axes_of
from ipnet.errors import ConfigError
from ipnet.figures import Figures, Statements, figures
from ipnet.fusion import SPREAD, nothing_known
from ipnet.offsets import OFFSET, offsets_of, slope
from ipnet.runs import Run, Span, run, silent
from ipnet.seen import seen_by
from navcore.arrays import Floats
from navcore.prior import BiasPrior, load_prior

Progress = Callable[[int, int], None]
"""Gets the number of runs done and of all."""


@dataclass(frozen=True)
class ScoreConfig:
    """What is asked.

    Attributes:
        priors: specs of sources, as `window-mean` or `ipnet:euroc`.
        device: spec of a source whose `device()` is joined in, as `constant:device.json`; empty for none.
        frame: axes of the errors: `imu`, `thrust`, or `x,y,z` (`axes_of`).
        offset: size of the injected offsets [rad/s, m/s^2]; zeros for none.
        spread: sd of a bias where nothing is known of the device [rad/s, m/s^2].
        seed: of the intervals.
    """

    priors: tuple[str, ...]
    device: str = ""
    frame: str = "imu"
    offset: tuple[float, float] = OFFSET
    spread: tuple[float, float] = SPREAD
    seed: int = 1

    def __post_init__(self) -> None:
        if not self.priors:
            raise ConfigError("no prior is named; expected specs such as window-mean or constant:device.json")
        if min(self.spread) <= 0.0 or min(self.offset) < 0.0 or (min(self.offset) == 0.0 < max(self.offset)):
            raise ConfigError(
                f"spread is {self.spread}, offset {self.offset}; expected rad/s, m/s^2, positive, or 0 0 for no offset"
            )


@dataclass(frozen=True)
class ArmScore:
    """One source from one start.

    Attributes:
        arm: spec of the source; with the device's before it where that was joined in.
        over_run: of the fused estimate at the end of each run.
        windows: of the single measurements, with what is constant over a run in the stated covariance; None if the
            source made none.
        response: (G,) slope of the estimate over a run by an injected offset, mean over a group's axes; empty if
            none was injected.
        response_matrix: (6, 6) the same from each axis (column) to each (row).
        gain: (G,) nats of likelihood over a run above the constant prior's.
        silent: runs without a measurement.
        seen: recordings scored here that the source was made from.
        joined: whether the config's device was joined in; single measurements are the same with and without.
    """

    arm: str
    over_run: Figures
    windows: Figures | None
    response: tuple[float, ...]
    response_matrix: tuple[tuple[float, ...], ...]
    gain: tuple[float, ...]
    silent: int
    seen: tuple[str, ...]
    joined: bool


@dataclass(frozen=True)
class Scores:
    """The answer.

    Attributes:
        config: what was asked.
        recordings: names.
        runs: how many spans of them.
        seconds: mean length of a span.
        axes: frame and groups.
        constant: of the start alone, the device's mean and covariance, or the wide prior without a device: carried to
            the end of each run by the same filter, without a measurement.
        arms: in the order asked.
    """

    config: ScoreConfig
    recordings: tuple[str, ...]
    runs: int
    seconds: float
    axes: Axes
    constant: Figures
    arms: tuple[ArmScore, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        content = asdict(self)
        content["axes"]["R_FB"] = self.axes.R_FB.tolist()
        return content


@dataclass(frozen=True)
class _Answers:
    """One source on one span: as it is, and with offsets (M, 6) injected."""

    plain: Run
    offsets: Floats
    moved: tuple[Run, ...]


def score(spans: ListLike[Span], config: ScoreConfig, progress: Progress | None = None) -> Scores:
    """Score every source on every span.

    Raises:
        ConfigError: a source or a frame is unknown, or the device's source knows no device.
    """
    for spec in config.priors:
        load_prior(spec, spans[0].sequence)  # what is wrong with a spec is said before the work begins
    axes = axes_of(config.frame, spans)
    recordings = tuple(dict.fromkeys(s.recording for s in spans))
    start = nothing_known(0, config.spread)
    device = _device(config.device)
    constant = _over_run(spans, [silent(span).fused(device or start) for span in spans], axes, config)
    arms: list[ArmScore] = []
    for k, spec in enumerate(config.priors):
        answers = []
        for i, span in enumerate(spans):
            answers.append(_ask(spec, span, i, len(spans), config))
            if progress is not None:
                progress(k * len(spans) + i + 1, len(config.priors) * len(spans))
        own = answers[0].plain.device
        arms.append(_arm(spec, own or start, spans, answers, axes, constant, config))
        if own is None and device is not None:
            arms.append(_arm(f"{config.device},{spec}", device, spans, answers, axes, constant, config))
    seconds = float(np.mean([(s.end_ns - s.begin_ns) * 1e-9 for s in spans]))
    return Scores(config, recordings, len(spans), seconds, axes, constant, tuple(arms))


def _device(spec: str) -> BiasPrior | None:
    device = load_prior(spec).device() if spec else None
    if spec and device is None:
        raise ConfigError(f"device is {spec!r}, which knows no device; expected constant:FILE.json")
    return device


def _ask(spec: str, span: Span, index: int, count: int, config: ScoreConfig) -> _Answers:
    offsets = offsets_of(index, count, config.offset) if max(config.offset) > 0.0 else np.zeros((0, 6))
    moved = tuple(run(spec, span.with_offset(offset)) for offset in offsets)
    return _Answers(run(spec, span), offsets, moved)


def _arm(
    name: str,
    start: BiasPrior,
    spans: ListLike[Span],
    answers: ListLike[_Answers],
    axes: Axes,
    constant: Figures,
    config: ScoreConfig,
) -> ArmScore:
    fused = [a.plain.fused(start) for a in answers]
    over_run = _over_run(spans, fused, axes, config)
    matrix = _response(start, fused, answers, axes)
    return ArmScore(
        name,
        over_run,
        _windows(answers, axes, config),
        () if matrix is None else tuple((axes.pooling @ np.diag(matrix)).tolist()),
        () if matrix is None else tuple(tuple(row) for row in matrix.tolist()),
        tuple(c - own for c, own in zip(constant.nll, over_run.nll, strict=True)),
        sum(not a.plain.measurements for a in answers),
        tuple(sorted(seen_by(name) & {s.recording for s in spans})),
        name.startswith(f"{config.device},"),
    )


def _response(start: BiasPrior, fused: ListLike[BiasPrior], answers: ListLike[_Answers], axes: Axes) -> Floats | None:
    """(6, 6) in the frame's axes."""
    offsets = np.vstack([a.offsets for a in answers])
    if len(offsets) == 0:
        return None
    changes = [
        moved.fused(start).vector - plain.vector for plain, a in zip(fused, answers, strict=True) for moved in a.moved
    ]
    return slope(offsets @ axes.R6.T, np.array(changes) @ axes.R6.T)


def _over_run(spans: ListLike[Span], estimates: ListLike[BiasPrior], axes: Axes, config: ScoreConfig) -> Figures:
    """Figures of one estimate at the end of each span."""
    number = _numbers(spans)
    rows = [(n, e.vector - s.bias[-1], e.covariance) for n, s, e in zip(number, spans, estimates, strict=True)]
    return figures(Statements.of(rows), axes, np.random.default_rng(config.seed))


def _windows(answers: ListLike[_Answers], axes: Axes, config: ScoreConfig) -> Figures | None:
    runs = [a.plain for a in answers]
    number = _numbers([r.span for r in runs])
    rows = [
        (n, error, z.covariance + r.constant_covariance)
        for n, r in zip(number, runs, strict=True)
        for error, z in zip(r.errors.error, r.measurements, strict=True)
    ]
    return figures(Statements.of(rows), axes, np.random.default_rng(config.seed)) if rows else None


def _numbers(spans: ListLike[Span]) -> list[int]:
    """The number of each span's recording."""
    names = {name: n for n, name in enumerate(dict.fromkeys(s.recording for s in spans))}
    return [names[s.recording] for s in spans]

"""Starts of the filter from many times in a recording: how soon, how well, and as well as it says?

Each start is an own short run: the filter gets the recording from some time on, as if it had been switched on there,
until a few seconds after it has a pose. Each one is kept in a file of its own, so a stopped table goes on.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from collections.abc import Sequence as ListLike
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from threadpoolctl import threadpool_limits

from eval.alignment import align
from eval.consistency import errors_in_start_gauge
from eval.errors import StudyError
from eval.sources import Recording
from eval.tables import Table
from eval.versions import code_digest, versions
from eval.work import load_estimator
from navcore.arrays import Floats
from navcore.odometry import Estimate, Health, Odometry, RunRecorder
from navcore.prior import load_prior, split_prior
from navcore.readers import open_sequence
from navcore.sequence import Frame, Sequence
from navcore.trajectory import Trajectory

WITHIN_S, MAX_VELOCITY_ERROR, MAX_SCALE_ERROR = 3.0, 0.1, 0.05
"""A good start: seconds after usable vision, m/s at the start, share over the two seconds after it."""

_AFTER_S = 2.0  # of a run that is watched after its start
_GIVE_UP_S = 8.0  # without a start
_LEAST_FEATURES = 15  # of usable vision
_USABLE_S = 0.5  # that it has to last
_MIN_MOTION = 0.1  # m, spread of the true positions below which no scale can be told


@dataclass(frozen=True)
class StartScore:
    """One start; what there is none of is None.

    Attributes:
        recording: its name.
        begin_s: when the filter was switched on, in seconds from the first frame.
        vision_s: from there to usable vision: the first of 0.5 s of frames that follow 15 features or more.
        start_s: from there to the first pose.
        reason: why there was no pose, as the filter says; empty if there was one.
        speed: m/s, the true one at the start.
        velocity, velocity_1s, velocity_2s: m/s, error at the start and one and two seconds later.
        scale: size of the estimated path over the two seconds after the start by that of the true one, less 1.
        tilt: rad, error at the start; gyro_bias [rad/s] and accel_bias [m/s^2] likewise.
        velocity_sigma: m/s, what the filter says of the velocity at the start: root mean square over the axes.
        nees_tilt, nees_velocity, nees_gyro_bias, nees_accel_bias: at the start, by degree of freedom.
        nees: of the three velocities, tilt and biases together, likewise: their correlations count.
        lost: whether the filter was lost again in those two seconds.
        attempt_ms: CPU of the dearest attempt.
    """

    recording: str
    begin_s: float
    vision_s: float | None = None
    start_s: float | None = None
    reason: str = ""
    speed: float | None = None
    velocity: float | None = None
    velocity_1s: float | None = None
    velocity_2s: float | None = None
    scale: float | None = None
    tilt: float | None = None
    gyro_bias: float | None = None
    accel_bias: float | None = None
    velocity_sigma: float | None = None
    nees_tilt: float | None = None
    nees_velocity: float | None = None
    nees_gyro_bias: float | None = None
    nees_accel_bias: float | None = None
    nees: float | None = None
    lost: bool = False
    attempt_ms: float = 0.0

    @property
    def in_time(self) -> bool:
        """Whether it came within three seconds of usable vision."""
        return self.start_s is not None and self.start_s - (self.vision_s or 0.0) <= WITHIN_S

    @property
    def exact(self) -> bool:
        """Whether velocity and scale are right; a scale that cannot be told is not wrong."""
        known = self.velocity is not None and self.velocity <= MAX_VELOCITY_ERROR
        return known and abs(self.scale or 0.0) <= MAX_SCALE_ERROR and not self.lost

    @property
    def good(self) -> bool:
        """Whether it came in time and is right."""
        return self.in_time and self.exact


@dataclass(frozen=True)
class Asked:
    """What a table of starts is made with.

    Attributes:
        times: starts of a recording, evenly over it.
        prior: as `load_prior` takes it.
        overrides: settings of the filter by dotted name.
        lead_s: IMU before the first frame: a prior that watches the motion needs some.
    """

    times: int = 20
    prior: str = "none"
    overrides: Mapping[str, Any] | None = None
    lead_s: float = 0.1


def measure_starts(
    paths: ListLike[Path], asked: Asked, out: Path, progress: Callable[[int, int], None] | None = None
) -> list[StartScore]:
    """The starts of some recordings; those that `out` holds already are read from there.

    Args:
        paths: recordings with truth.
        asked: which starts.
        out: folder of their files.
        progress: is told how many are done, and of how many.

    Raises:
        StudyError: a recording has no truth with velocity and biases, or is too short.
    """
    out.mkdir(parents=True, exist_ok=True)
    names = tuple(part.partition(":")[0] for part in split_prior(asked.prior))
    made_with = {**versions(("msckf",), names), "starts": code_digest((), [Path(__file__)])}
    scores: list[StartScore] = []
    for path in paths:
        sequence = open_sequence(path)
        recording = Recording.of(path, sequence)
        for begin_s in start_times(sequence, asked.times):
            key = _key(recording, begin_s, asked, made_with)
            file = out / f"{key}.json"
            if file.is_file():
                scores.append(StartScore(**json.loads(file.read_text())))
            else:
                cv2.setNumThreads(1)
                with threadpool_limits(1):
                    scores.append(measure_start(sequence, recording.name, begin_s, asked))
                partial = file.with_suffix(".partial")
                partial.write_text(json.dumps(asdict(scores[-1])))
                partial.replace(file)
            if progress is not None:
                progress(len(scores), len(paths) * asked.times)
    return scores


def start_times(sequence: Sequence, times: int) -> Floats:
    """(times,) seconds from the first frame: evenly over the frames that truth covers, the last with room behind it.

    Raises:
        StudyError: no truth, or too little of it.
    """
    truth = sequence.truth
    if truth is None or truth.v_WB is None or truth.b_g is None or truth.b_a is None:
        raise StudyError(f"{sequence.name}: starts are judged by a truth with velocity and biases; it has none")
    stamps = np.array([frame.t_ns for frame in sequence.frames], dtype=np.int64)
    offset_ns = round(sequence.calibration.cameras[0].dt_cam_imu * 1e9)
    covered = stamps[truth.covers(stamps + offset_ns)]
    room_s = WITHIN_S + _AFTER_S
    if len(covered) < 2 or (covered[-1] - covered[0]) * 1e-9 < room_s:
        raise StudyError(f"{sequence.name}: truth covers less than {room_s} s of frames")
    first, last = (covered[0] - stamps[0]) * 1e-9, (covered[-1] - stamps[0]) * 1e-9 - room_s
    return np.asarray(np.round(np.linspace(first, last, times), 3), dtype=np.float64)


def measure_start(sequence: Sequence, name: str, begin_s: float, asked: Asked) -> StartScore:
    """One start: the filter is switched on `begin_s` after the first frame."""
    zero_ns = sequence.frames[0].t_ns + round(begin_s * 1e9)
    part = sequence.span(begin_s, begin_s + _GIVE_UP_S + _AFTER_S)
    imu = sequence.imu.between(zero_ns - round(asked.lead_s * 1e9), part.frames[-1].t_ns + 100_000_000)
    part = Sequence(part.name, part.calibration, imu, part.frames, part.truth)
    odometry = load_estimator("msckf")(part.calibration, load_prior(asked.prior, sequence), asked.overrides or {})
    estimates = list(_until_started(odometry, part))
    start_ns = next((e.t_ns for e in estimates if e.state is not None), None)
    vision_s = _usable_vision(estimates, zero_ns)
    attempt_ms = 1e3 * max((e.stages.get("start", 0.0) for e in estimates), default=0.0)
    if start_ns is None:
        reason = estimates[-1].reasons[0] if estimates and estimates[-1].reasons else "no frames"
        return StartScore(name, begin_s, vision_s, reason=reason, attempt_ms=attempt_ms)
    lost = any(e.health is Health.LOST for e in estimates)
    started = StartScore(name, begin_s, vision_s, (start_ns - zero_ns) * 1e-9, lost=lost, attempt_ms=attempt_ms)
    return replace(started, **_errors(estimates, part.truth))


def _until_started(odometry: Odometry, sequence: Sequence) -> Iterator[Estimate]:
    """Estimates of a run up to `_AFTER_S` after its first pose."""
    end_ns: int | None = None
    for event in sequence.events():
        new = odometry.add_frame(event) if isinstance(event, Frame) else odometry.add_imu(event)
        for estimate in new:
            if end_ns is None and estimate.state is not None:
                end_ns = estimate.t_ns + round(_AFTER_S * 1e9) + 1_000_000
            if end_ns is not None and estimate.t_ns > end_ns:
                return
            yield estimate
        if end_ns is None and new and new[-1].t_ns > sequence.frames[0].t_ns + round(_GIVE_UP_S * 1e9):
            return


def _usable_vision(estimates: ListLike[Estimate], zero_ns: int) -> float | None:
    """Seconds to the first of `_USABLE_S` of frames that follow enough features."""
    since_ns: int | None = None
    for e in estimates:
        if e.tracked < _LEAST_FEATURES:
            since_ns = None
            continue
        since_ns = e.t_ns if since_ns is None else since_ns
        if e.t_ns - since_ns >= round(_USABLE_S * 1e9) or e.state is not None:
            return (since_ns - zero_ns) * 1e-9
    return None


def _errors(estimates: ListLike[Estimate], truth: Trajectory | None) -> dict[str, Any]:
    """Errors of a run that started, named as in `StartScore`."""
    assert truth is not None
    recorder = RunRecorder()
    recorder.add([e for e in estimates if e.state is not None])
    path = recorder.result().trajectory
    first = next(e.state for e in estimates if e.state is not None)
    errors = errors_in_start_gauge(path, truth)  # (M, 5, 3)
    speeds = np.linalg.norm(errors[:, 2], axis=1)
    true = truth.at(path.t_ns)
    assert true.v_WB is not None
    T = np.zeros((11, 15))  # tilt about W's x and y, velocity, biases
    T[0:2, 0:3] = first.R_WB[:2]
    T[2:, 6:] = np.eye(9)
    e, P = T @ errors[0].ravel(), T @ first.covariance @ T.T
    blocks = {"nees_tilt": slice(0, 2), "nees_velocity": slice(2, 5)}
    blocks |= {"nees_gyro_bias": slice(5, 8), "nees_accel_bias": slice(8, 11), "nees": slice(0, 11)}
    return {
        "speed": float(np.linalg.norm(true.v_WB[0])),
        "velocity": float(speeds[0]),
        "velocity_1s": _at(path.seconds, speeds, 1.0),
        "velocity_2s": _at(path.seconds, speeds, 2.0),
        "scale": scale_error(path, true),
        "tilt": float(np.linalg.norm(e[:2])),
        "gyro_bias": float(np.linalg.norm(errors[0, 3])),
        "accel_bias": float(np.linalg.norm(errors[0, 4])),
        "velocity_sigma": float(np.sqrt(np.trace(P[2:5, 2:5]) / 3.0)),
        **{name: float(e[b] @ np.linalg.solve(P[b, b], e[b])) / (b.stop - b.start) for name, b in blocks.items()},
    }


def scale_error(path: Trajectory, true: Trajectory) -> float | None:
    """Size of a path against the true one at the same times, less 1; None if that one hardly moved.

    The size is the factor by which the true path, turned about the vertical to fit, has to be stretched: the slope of
    the estimated positions over the true ones, both about their means.
    """
    p, p_true = path.p_WB, true.p_WB
    p_true = p_true - p_true.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum(p_true**2, axis=1))))
    if spread < _MIN_MOTION:
        return None
    turned = p @ align(p, true.p_WB).R_WV.T
    return float(np.sum((turned - turned.mean(axis=0)) * p_true) / np.sum(p_true**2)) - 1.0


def _at(seconds: Floats, values: Floats, t_s: float) -> float | None:
    k = int(np.argmin(np.abs(seconds - t_s)))
    return float(values[k]) if abs(seconds[k] - t_s) < 0.1 else None


def _key(recording: Recording, begin_s: float, asked: Asked, made_with: dict[str, str]) -> str:
    work = {"recording": asdict(recording), "begin_s": float(begin_s), "versions": made_with}
    work |= {"prior": asked.prior, "overrides": dict(asked.overrides or {}), "lead_s": asked.lead_s}
    return hashlib.sha256(json.dumps(work, sort_keys=True).encode()).hexdigest()[:20]


def starts_table(scores: ListLike[StartScore]) -> Table:
    """A row for each recording, and one for all: medians and 95 % quantiles over those that started, NEES as means."""
    groups: dict[str, list[StartScore]] = {}
    for score in scores:
        groups.setdefault(score.recording, []).append(score)
    if len(groups) > 1:
        groups["all"] = list(scores)
    columns = (
        *("recording", "starts", "good", "in time", "start [s]", "95 %", "velocity [m/s]", "95 %", "2 s later, 95 %"),
        *("scale", "95 %", "tilt [°], 95 %", "NEES velocity", "tilt", "b_g", "b_a", "together", "attempt [ms], 95 %"),
    )
    rows = tuple((name, *_cells(group)) for name, group in groups.items())
    return Table(f"Starts from many times: good is within {WITHIN_S:g} s, {MAX_VELOCITY_ERROR} m/s, 5 %", columns, rows)


def _cells(group: list[StartScore]) -> tuple[str, ...]:
    """The figures of one recording."""

    def over(name: str, quantile: float, form: str, factor: float = 1.0) -> str:
        values = [abs(x) for score in group if (x := getattr(score, name)) is not None]
        return format(factor * float(np.quantile(values, quantile)), form) if values else "–"

    def mean(name: str) -> str:
        values = [x for score in group if (x := getattr(score, name)) is not None]
        return f"{np.mean(values):.1f}" if values else "–"

    return (
        str(len(group)),
        f"{np.mean([score.good for score in group]):.0%}",
        f"{np.mean([score.in_time for score in group]):.0%}",
        *(over("start_s", 0.5, ".2f"), over("start_s", 0.95, ".2f")),
        *(over("velocity", 0.5, ".3f"), over("velocity", 0.95, ".3f"), over("velocity_2s", 0.95, ".3f")),
        *(over("scale", 0.5, ".1%"), over("scale", 0.95, ".1%"), over("tilt", 0.95, ".2f", np.degrees(1.0))),
        *(mean(f"nees_{name}") for name in ("velocity", "tilt", "gyro_bias", "accel_bias")),
        *(mean("nees"), over("attempt_ms", 0.95, ".0f")),
    )

"""One estimator on one recording, from its folder to a folder of results: what every `python -m ESTIMATOR run` does."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text
from threadpoolctl import threadpool_limits

from eval.metrics import score
from navcore.errors import ConfigError
from navcore.odometry import Following, Odometry, Run, State, TimedState
from navcore.odometry import run as run_odometry
from navcore.prior import BiasPriorSource, load_prior
from navcore.readers import open_sequence
from navcore.results import check_free, summarise, write_run
from navcore.sequence import Sequence

_TRUTH_SIGMAS = np.repeat([2e-3, 0.0, 0.01, 1e-3, 0.05], 3)  # rad, m, m/s, rad/s, m/s^2: of a start from truth
_UNKNOWN_BIAS = np.repeat([0.1, 0.2], 3)  # rad/s, m/s^2: of biases that the truth does not know


@dataclass(frozen=True)
class Asked:
    """What a run is asked for.

    Attributes:
        path: folder of the recording.
        out: folder to write; it must not hold results yet.
        prior: where bias priors come from.
        start, end: seconds from the first frame, or None.
        from_truth: begin with the state of the truth.
        cameras: how many are used; to draw them.
        viewer, file: show the run in Rerun's viewer; write it for the viewer.
    """

    path: Path
    out: Path
    prior: str
    start: float | None
    end: float | None
    from_truth: bool
    cameras: int
    viewer: bool = False
    file: Path | None = None


def run_recording(
    asked: Asked,
    estimator: Callable[[Sequence, BiasPriorSource, TimedState | None], Following],
    settings: Mapping[str, Any],
) -> None:
    """Run an estimator, write its folder of results, and say how it went.

    Args:
        asked: what.
        estimator: makes it for a recording, a prior and a state to start from, or None.
        settings: of the estimator, to be written down.

    Raises:
        NavcoreError: something that was asked for cannot be had; nothing is written.
    """
    check_free(asked.out)
    cv2.setNumThreads(1)
    with threadpool_limits(1):
        sequence = open_sequence(asked.path)
        if asked.start is not None or asked.end is not None:
            sequence = sequence.span(asked.start, asked.end)
        if not sequence.frames:
            raise ConfigError(f"{asked.path}: the recording has no frames; expected images or tracks of cam0")
        told = truth_start(sequence) if asked.from_truth else None
        vio = estimator(sequence, load_prior(asked.prior, sequence), told)
        odometry = vio if not asked.viewer and asked.file is None else _drawn(vio, sequence, asked)
        with Progress(
            TextColumn(sequence.name), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
        ) as bar:
            task = bar.add_task("frames", total=len(sequence.frames))
            result = run_odometry(odometry, sequence, lambda done: bar.update(task, completed=done))
    summary = summarise(result, sequence)
    if sequence.truth is not None and result.has_state.any():
        summary |= score(result.trajectory, sequence.truth)
    span = {"start_s": asked.start, "end_s": asked.end}
    begin = {"from_truth": asked.from_truth}
    options = {"path": str(asked.path), "bias_prior": asked.prior, **begin, **span, **settings}
    write_run(asked.out, result, sequence, options, summary)
    _report(result, summary, asked.out)


def _drawn(vio: Following, sequence: Sequence, asked: Asked) -> Odometry:
    """The estimator, drawn while it runs; what that takes is imported only here."""
    from navcore.drawing import Canvas, Drawn, open_stream

    stream = open_stream(sequence.name, cameras=asked.cameras, viewer=asked.viewer, file=asked.file)
    return Drawn(vio, Canvas(stream, sequence.calibration, asked.cameras, sequence.truth))


def truth_start(sequence: Sequence) -> TimedState:
    """The state of the truth at the first frame that it covers, for ablations.

    Raises:
        ConfigError: the recording has no truth with velocity there.
    """
    truth = sequence.truth
    if truth is None or truth.v_WB is None:
        raise ConfigError(f"{sequence.name}: a start from truth needs a truth with velocity, the recording has none")
    offset_ns = round(sequence.calibration.cameras[0].dt_cam_imu * 1e9)
    for frame in sequence.frames:
        t_ns = frame.t_ns + offset_ns
        if not truth.covers(np.array([t_ns]))[0]:
            continue
        s = truth.at(np.array([t_ns]))
        b_g, b_a = (np.zeros(3) if b is None or not np.isfinite(b).all() else b[0] for b in (s.b_g, s.b_a))
        sigmas = _TRUTH_SIGMAS.copy()
        if s.b_g is None or not np.isfinite(s.b_g).all():
            sigmas[9:] = _UNKNOWN_BIAS
        if s.v_WB is not None and np.isfinite(s.v_WB).all():
            return TimedState(t_ns, State(s.R_WB[0], s.p_WB[0], s.v_WB[0], b_g, b_a, np.diag(sigmas**2)))
    raise ConfigError(f"{sequence.name}: truth covers no frame")


def _report(result: Run, summary: dict[str, object], out: Path) -> None:
    """The end summary."""
    table = Table(title=f"{len(result.estimates)} frames, written to {out}")
    table.add_column("figure")
    table.add_column("value", justify="right")
    cost = summary["cpu_ms_per_frame"]
    assert isinstance(cost, dict)
    rows = {"CPU [ms a frame, mean]": cost["mean"], "CPU [ms a frame, median]": cost["median"]}
    labels = {
        "completeness": "share of frames with a pose",
        "start_s": "first pose [s after the first frame]",
        "peak_rss_mb": "peak memory [MB]",
        "ate_m": "ATE [m]",
        "ate_deg": "ATE [deg]",
        "rpe_m": "RPE [m a frame]",
        "rpe_rad": "RPE [rad a frame]",
        "b_g_rmse": "gyroscope bias error [rad/s]",
        "b_a_rmse": "accelerometer bias error [m/s^2]",
    }
    rows |= {label: summary[key] for key, label in labels.items() if summary.get(key) is not None}
    for label, value in rows.items():
        table.add_row(Text(label), f"{value:.5g}" if isinstance(value, float) else str(value))
    health = summary["health"]
    assert isinstance(health, dict)
    table.add_row("health", ", ".join(f"{name} {n}" for name, n in health.items() if n))
    skipped = summary["skipped_frames"]
    assert isinstance(skipped, list)
    for line in skipped:
        table.add_row("skipped", Text(line))
    Console().print(table)

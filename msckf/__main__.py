"""`python -m msckf run`: the filter on a recording, from its folder to a folder of results."""

import dataclasses
import sys
from pathlib import Path

import cv2
import numpy as np
import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text
from threadpoolctl import threadpool_limits

from eval.errors import EvalError
from eval.metrics import score
from msckf.config import FilterConfig, StartConfig, StartMode
from msckf.filter import Filter, TimedState
from navcore.command_line import command_line
from navcore.errors import ConfigError
from navcore.odometry import Odometry, Run, State
from navcore.odometry import run as run_odometry
from navcore.prior import PriorMode, load_prior
from navcore.readers import open_sequence
from navcore.results import check_free, summarise, write_run
from navcore.sequence import Sequence

_TRUTH_SIGMAS = np.repeat([2e-3, 0.0, 0.01, 1e-3, 0.05], 3)  # rad, m, m/s, rad/s, m/s^2: of a start from truth


def run(
    path: tyro.conf.Positional[Path],
    out: Path,
    prior: str = "none",
    cameras: int | None = None,
    start: float | None = None,
    end: float | None = None,
    init: StartMode | None = None,
    prior_mode: PriorMode | None = None,
    prior_weight: float | None = None,
    rerun: bool = False,
    rerun_save: Path | None = None,
    config: FilterConfig = FilterConfig(),  # noqa: B008
) -> int:
    """Run the filter on a recording in EuRoC's or TUM-VI's layout.

    Args:
        path: folder of the recording.
        out: folder to write; it must not hold results yet.
        prior: where bias priors come from: none, motion:NAME, ipnet:NAME, constant:FILE.json, file:FILE.csv, truth,
            or a source of another package; a device and a source are joined as constant:FILE.json,SOURCE.
        cameras: how many of the rig's cameras are used; short for --config.cameras.
        start: seconds from the first frame.
        end: seconds from the first frame.
        init: standing still, in motion, whichever comes first, or from the truth; short for --config.start.mode.
        prior_mode: modelled (the prior's own error is a state) or plain (the paper's fixed weight); short for
            --config.prior.mode.
        prior_weight: W of the plain mode; short for --config.prior.weight.
        rerun: show the run in Rerun's viewer, live.
        rerun_save: write it for the viewer, by custom as FILE.rrd.
        config: all settings.
    """
    check_free(out)
    cv2.setNumThreads(1)
    with threadpool_limits(1):
        sequence = open_sequence(path)
        if start is not None or end is not None:
            sequence = sequence.span(start, end)
        if not sequence.frames:
            raise ConfigError(f"{path}: the recording has no frames; expected images or tracks of cam0")
        short = {
            "cameras": cameras,
            "start.mode": init,
            "prior.mode": prior_mode,
            "prior.weight": prior_weight,
        }
        config = config.with_overrides({name: value for name, value in short.items() if value is not None})
        told = truth_start(sequence) if config.start.mode == "truth" else None
        vio = Filter(sequence.calibration, config, load_prior(prior, sequence), told)
        odometry = _drawn(vio, sequence, viewer=rerun, file=rerun_save) if rerun or rerun_save is not None else vio
        with Progress(
            TextColumn(sequence.name), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
        ) as bar:
            task = bar.add_task("frames", total=len(sequence.frames))
            result = run_odometry(odometry, sequence, lambda done: bar.update(task, completed=done))
    summary = summarise(result, sequence)
    if sequence.truth is not None and result.has_state.any():
        summary |= score(result.trajectory, sequence.truth)
    options = {"path": str(path), "prior": prior, "start": start, "end": end, **dataclasses.asdict(config)}
    write_run(out, result, sequence, options, summary)
    _report(result, summary, out)
    return 0


def _drawn(vio: Filter, sequence: Sequence, *, viewer: bool, file: Path | None) -> Odometry:
    """The filter, drawn while it runs; what that takes is imported only here."""
    from navcore.drawing import Canvas, Drawn, open_stream

    cameras = vio.config.cameras
    stream = open_stream(sequence.name, cameras=cameras, viewer=viewer, file=file)
    return Drawn(vio, Canvas(stream, sequence.calibration, cameras, sequence.truth))


def truth_start(sequence: Sequence) -> TimedState:
    """The state of the truth at the first frame that it covers, for ablations.

    Raises:
        ConfigError: the recording has no truth with velocity there.
    """
    truth = sequence.truth
    if truth is None or truth.v_WB is None:
        raise ConfigError(f"{sequence.name}: --init truth needs a truth with velocity, the recording has none")
    offset_ns = round(sequence.calibration.cameras[0].dt_cam_imu * 1e9)
    for frame in sequence.frames:
        t_ns = frame.t_ns + offset_ns
        if not truth.covers(np.array([t_ns]))[0]:
            continue
        s = truth.at(np.array([t_ns]))
        b_g, b_a = (np.zeros(3) if b is None or not np.isfinite(b).all() else b[0] for b in (s.b_g, s.b_a))
        sigmas = _TRUTH_SIGMAS.copy()
        if s.b_g is None or not np.isfinite(s.b_g).all():
            sigmas[9:] = np.repeat([StartConfig.gyro_bias_sigma, StartConfig.accel_bias_sigma], 3)
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


def main() -> int:
    """Parse the command line and run it."""
    with command_line(EvalError):
        return int(tyro.extras.subcommand_cli_from_dict({"run": run}, prog="python -m msckf"))


if __name__ == "__main__":
    sys.exit(main())

"""The folder that a run leaves behind, written whole or not at all, and read back for evaluation.

`trajectory.tum`, `biases.csv`, `frames.csv` and `run.json`; docs/conventions.md has their columns.
"""

import csv
import json
import math
import platform
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from navcore.arrays import Floats, frozen
from navcore.errors import DataError
from navcore.odometry import BLOCKS, Run
from navcore.readers.table import read_table
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory

TRAJECTORY, BIASES, FRAMES, RUN = "trajectory.tum", "biases.csv", "frames.csv", "run.json"

_PACKAGES = ("msckf-ipnet", "numpy", "scipy", "opencv-python-headless")
_BIAS_NAMES = [f"{s}{b}_{x}" for s in ("", "sigma_") for b in ("b_g", "b_a") for x in "xyz"]
_BIAS_ROW = "t_ns, b_g x y z [rad/s], b_a x y z [m/s^2], sigma of the six"
_FRAME_NAMES = ["t_ns", "health", "reasons", "tracked", "used"]


@dataclass(frozen=True)
class StoredRun:
    """A run folder, read back.

    Attributes:
        trajectory: causal estimates in IMU time, with biases; velocities are not stored.
        sigma: (N, 6) standard deviations of b_g [rad/s] and b_a [m/s^2].
        config: what the run was made with.
        summary: figures of the run.
    """

    trajectory: Trajectory
    sigma: Floats
    config: Mapping[str, Any]
    summary: Mapping[str, Any]


def check_free(out: Path) -> None:
    """Make sure that a run can be written to `out`; call it before any work.

    Raises:
        DataError: `out` is a file, or a folder with something in it.
    """
    if out.is_dir():
        found = sorted(x.name for x in out.iterdir())
        if found:
            held = ", ".join(found[:4])
            raise DataError(f"{out}: already holds {held}; expected a new or an empty folder")
    elif out.exists():
        raise DataError(f"{out}: is a file; expected a new or an empty folder")


def write_run(out: Path, run: Run, sequence: Sequence, config: Mapping[str, Any], summary: Mapping[str, Any]) -> None:
    """Write the folder of a run; it appears under its name when it is complete.

    Args:
        out: the folder; new or empty.
        run: what the estimator said.
        sequence: what it was given.
        config: what it was told; anything that JSON can hold, dataclasses, enums, paths and arrays.
        summary: figures to keep, usually those of `summarise` and scores against truth.

    Raises:
        DataError: `out` is not free.
    """
    check_free(out)
    partial = out.with_name(out.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        run.trajectory.to_tum(partial / TRAJECTORY)
        _write_biases(partial / BIASES, run)
        _write_frames(partial / FRAMES, run)
        _write_description(partial / RUN, sequence, config, summary)
        partial.replace(out)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def read_run(path: Path) -> StoredRun:
    """The run in a folder that `write_run` made.

    Raises:
        DataError: a file is missing, or not what it should be.
    """
    description = path / RUN
    if not description.is_file():
        raise DataError(f"{description}: no such file; expected the folder of a run")
    try:
        content = json.loads(description.read_text(encoding="utf-8"))
        config, summary = content["config"], content["summary"]
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(f"{description}: not the description of a run: {error!r}") from error
    poses = Trajectory.from_tum(path / TRAJECTORY)
    if len(poses) == 0:
        return StoredRun(poses, frozen("sigma", np.zeros((0, 6)), np.float64, (0, 6)), config, summary)
    t_ns, values = read_table(path / BIASES, 12, _BIAS_ROW)
    if not np.array_equal(t_ns, poses.t_ns):
        raise DataError(f"{path / BIASES}: stamps are not those of {path / TRAJECTORY}")
    trajectory = Trajectory(t_ns, poses.q_WB, poses.p_WB, None, values[:, :3], values[:, 3:6])
    return StoredRun(trajectory, frozen("sigma", values[:, 6:], np.float64, (None, 6)), config, summary)


def _write_biases(path: Path, run: Run) -> None:
    trajectory = run.trajectory
    blocks = [BLOCKS.index("db_g"), BLOCKS.index("db_a")]
    sigma = run.sigmas[:, blocks].reshape(-1, 6)
    assert trajectory.b_g is not None and trajectory.b_a is not None
    rows = np.hstack([trajectory.b_g, trajectory.b_a, sigma])
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(["t_ns", *_BIAS_NAMES]) + "\n")
        for t_ns, row in zip(trajectory.t_ns.tolist(), rows.tolist(), strict=True):
            file.write(f"{t_ns}," + ",".join(f"{x:.9e}" for x in row) + "\n")


def _write_frames(path: Path, run: Run) -> None:
    stages = sorted({stage for e in run.estimates for stage in e.stages})
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*_FRAME_NAMES, *(f"{stage}_ms" for stage in stages)])
        for e in run.estimates:
            times = [f"{1e3 * e.stages.get(stage, 0.0):.4f}" for stage in stages]
            table.writerow([e.t_ns, e.health.value, "; ".join(e.reasons), e.tracked, e.used, *times])


def _write_description(path: Path, sequence: Sequence, config: Mapping[str, Any], summary: Mapping[str, Any]) -> None:
    cameras = [f"{m.camera.model} {m.camera.width}x{m.camera.height}" for m in sequence.calibration.cameras]
    stamps = [sequence.frames[k].t_ns for k in (0, -1)] if sequence.frames else []
    content = {
        "config": config,
        "input": {
            "name": sequence.name,
            "frames": len(sequence.frames),
            "first_and_last_frame_ns": stamps,
            "imu_samples": len(sequence.imu),
            "cameras": cameras,
            "truth": sequence.truth is not None,
            "notes": sequence.notes,
        },
        "versions": _versions(),
        "summary": summary,
    }
    text = json.dumps(_plain(content), indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _plain(value: Any) -> Any:
    """`value` in the types of JSON; numbers that are not finite become null."""
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Enum):
        return _plain(value.value)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

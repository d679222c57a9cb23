"""`python -m ipnet label`: the biases under which the IMU meets the truth, one a recording."""

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table
from threadpoolctl import threadpool_limits

from ipnet.errors import IpnetError, LabelError
from ipnet.labels import GoodPath, LabelConfig, SolvedLabel, good_path, label, read_rows, row, write_rows
from ipnet.recordings import Label as KnownLabel
from ipnet.recordings import find, read_labels, true_bias
from navcore.arrays import Floats
from navcore.errors import NavcoreError
from navcore.readers import open_sequence
from navcore.sequence import Sequence
from navcore.trajectory import Trajectory


@dataclass(frozen=True)
class _Found:
    """A label, what it is compared with (6,) and with what covariance, and the CPU seconds that it took."""

    solved: SolvedLabel
    true: Floats | None
    covariance: Floats
    seconds: float

    @property
    def off(self) -> Floats | None:
        """(6,) the label less that."""
        return None if self.true is None else self.solved.label.bias - self.true


@dataclass(frozen=True)
class Label:
    """Find one bias for each recording: that under which its preintegrated IMU meets its truth."""

    paths: tyro.conf.Positional[tuple[Path, ...]]  # recordings, or folders that hold some at any depth
    out: Path | None = None  # file to write; labels of other recordings that it holds stay
    trajectory: Path | None = None  # a filter's run in place of the truth, or a folder of runs by recordings' names
    figure: Path | None = None  # PNG to draw: labels against true means, where truth has biases
    against: Path | None = None  # labels to compare with where they are known, in place of true biases
    source: str = ""  # data set and owner, kept with each label
    config: tyro.conf.OmitArgPrefixes[LabelConfig] = field(default_factory=LabelConfig)

    def run(self, console: Console) -> None:
        """Label them all; one that cannot be labelled is named and does not lose the others."""
        if not self.paths:
            raise LabelError("no PATH; expected recordings, or folders that hold some")
        if self.out is None and self.figure is None:
            raise LabelError("nothing to write: --out FILE.json, --figure FILE.png, or both are needed")
        rows = {r["sequence"]: r for r in read_rows(self.out)} if self.out is not None else {}
        known = read_labels(self.against) if self.against is not None else {}
        folders = [folder for path in self.paths for folder in find(path)]
        found: list[_Found] = []
        failed: list[str] = []
        with threadpool_limits(1):
            for folder in track(folders, "labelling", console=console):
                try:
                    sequence = open_sequence(folder)
                    path = self._path(sequence.name, len(folders))
                    begun = time.process_time()
                    solved = label(sequence, self.config, path)
                    seconds = time.process_time() - begun
                    found.append(_compared(solved, sequence, known.get(sequence.name), seconds))
                    rows[sequence.name] = row(solved, sequence, self.source, _kind(sequence, path))
                except (IpnetError, NavcoreError) as error:
                    failed.append(str(error) if str(folder) in str(error) else f"{folder}: {error}")
        if found:
            console.print(_table(found))
        for line in failed:
            console.print(f"no label: {line}", style="red", markup=False, highlight=False)
        if not found:
            raise LabelError(f"none of {len(folders)} recordings could be labelled")
        if self.out is not None:
            write_rows(self.out, rows.values())
            console.print(f"wrote {len(found)} of {len(folders)} labels to {self.out}", highlight=False)
        if self.figure is not None:
            from ipnet.labels.figure import draw

            draw(self.figure, [(x.solved.label, x.true) for x in found if x.true is not None])
            console.print(f"drew {self.figure}", highlight=False)

    def _path(self, name: str, recordings: int) -> GoodPath | None:
        if self.trajectory is None:
            return None
        named = self.trajectory / name
        if not named.is_dir() and recordings > 1:
            raise LabelError(f"{named}: no such run; with several recordings, runs are found by their names")
        return good_path(named if named.is_dir() else self.trajectory)


def _compared(solved: SolvedLabel, sequence: Sequence, other: KnownLabel | None, seconds: float) -> _Found:
    covariance = solved.label.covariance
    if other is None:
        return _Found(solved, true_bias(sequence.truth), covariance, seconds)
    return _Found(solved, other.bias, covariance + other.covariance, seconds)


def _kind(sequence: Sequence, path: GoodPath | None) -> str:
    """What a label rests on, in words."""
    if path is not None:
        return f"a filter's path where it rates it good, {_rate(path.poses):.0f} Hz"
    truth = sequence.truth
    assert truth is not None
    return f"poses of the recording's truth, {_rate(truth):.0f} Hz"


def _rate(path: Trajectory) -> float:
    return 1e9 / float(np.median(np.diff(path.t_ns))) if len(path) > 1 else 0.0


def _table(found: list[_Found]) -> Table:
    table = Table(
        title="labels ± standard deviations; errors are against the mean of the true biases, or the labels of "
        "--against, and their rms over axes in standard deviations of both"
    )
    for name in ("recording", "b_g [mrad/s]", "b_a [m/s^2]", "error b_g", "error b_a", "in sd", "tilt [deg]"):
        table.add_column(name)
    table.add_column("offset [ms]")
    for name in ("segments", "left out", "rms gyro [mrad/s]", "rms acc. [m/s^2]", "CPU [s]"):
        table.add_column(name, justify="right")
    for x in found:
        solved, off = x.solved, x.off
        bias, sigma = solved.label.bias, np.sqrt(np.diag(solved.label.covariance))
        table.add_row(
            solved.label.sequence,
            _numbers(1e3 * bias[:3], 1e3 * sigma[:3], 3),
            _numbers(bias[3:], sigma[3:], 4),
            "" if off is None else _numbers(1e3 * off[:3], None, 3),
            "" if off is None else _numbers(off[3:], None, 4),
            "" if off is None else " ".join(f"{size:.1f}" for size in _in_sd(off, x.covariance)),
            "" if solved.tilt is None else _numbers(np.rad2deg(solved.tilt.value), np.rad2deg(solved.tilt.sigma), 2),
            "" if solved.offset is None else _numbers(1e3 * solved.offset.value, 1e3 * solved.offset.sigma, 1),
            str(solved.segments),
            str(solved.left_out),
            f"{1e3 * solved.rms[0]:.2f}",
            f"{solved.rms[1]:.3f}",
            f"{x.seconds:.2f}",
        )
    return table


def _in_sd(off: Floats, covariance: Floats) -> list[float]:
    """Of the gyroscope's error and of the accelerometer's."""
    halves = (slice(0, 3), slice(3, 6))
    return [float(np.sqrt(off[h] @ np.linalg.solve(covariance[h, h], off[h]) / 3.0)) for h in halves]


def _numbers(values: Floats, sigmas: Floats | None, digits: int) -> str:
    said = " ".join(f"{x:+.{digits}f}" for x in values)
    return said if sigmas is None else f"{said} ± " + " ".join(f"{x:.{digits}f}" for x in sigmas)

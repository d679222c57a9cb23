"""Estimates and truths as they lie on disk: a run's folder, an ASL folder, or a file in TUM format."""

from pathlib import Path

import numpy as np
import pandas as pd

from eval.errors import ScoreError
from navcore.readers import open_sequence, rosbag
from navcore.trajectory import Trajectory

_TRAJECTORY, _BIASES = "trajectory.tum", "biases.csv"
_COLUMNS = 6  # b_g (3), b_a (3) after the stamp


def read_estimate(path: Path) -> Trajectory:
    """The estimate in a file in TUM format, or in the folder of a run, there with biases if it has them.

    Raises:
        ScoreError: no such path, no trajectory in it, or biases that do not belong to it.
        DataError: a line that is none.
    """
    if path.is_file():
        return Trajectory.from_tum(path)
    if not (path / _TRAJECTORY).is_file():
        raise ScoreError(f"{path}: expected a file in TUM format, or a folder with {_TRAJECTORY}")
    found = Trajectory.from_tum(path / _TRAJECTORY)
    if not (path / _BIASES).is_file():
        return found
    return _with_biases(found, path / _BIASES)


def read_truth(path: Path) -> Trajectory:
    """The truth in a file in TUM format, or of a recording in a folder.

    Raises:
        ScoreError: no such path, or a recording without truth.
        DataError: a fault in a file.
    """
    if path.is_file() and not rosbag.recognises(path):
        return Trajectory.from_tum(path)
    if not path.exists():
        raise ScoreError(f"{path}: no such file or folder; expected a recording, or a file in TUM format")
    truth = open_sequence(path).truth
    if truth is None:
        raise ScoreError(f"{path}: the recording has no truth")
    return truth


def _with_biases(found: Trajectory, path: Path) -> Trajectory:
    expected = "rows of t_ns, b_g (3), b_a (3), sigma (6) at the stamps of the trajectory"
    try:
        table = pd.read_csv(path, comment="#", header=None, skiprows=_header_lines(path))
        t_ns = table[0].to_numpy(dtype=np.int64)
        values = table.iloc[:, 1 : 1 + _COLUMNS].to_numpy(dtype=np.float64)
    except (ValueError, KeyError) as error:
        raise ScoreError(f"{path}: expected {expected}: {error}") from error
    if values.shape[1] != _COLUMNS or len(t_ns) != len(found) or np.any(t_ns != found.t_ns):
        raise ScoreError(f"{path}: {len(t_ns)} rows that do not match {len(found)} poses; expected {expected}")
    return Trajectory(found.t_ns, found.q_WB, found.p_WB, None, values[:, :3], values[:, 3:])


def _header_lines(path: Path) -> int:
    """1 if the first line names the columns."""
    with path.open() as lines:
        first = lines.readline().lstrip("#")
    return int(not first.split(",")[0].strip().lstrip("-").isdecimal())

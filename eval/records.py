"""The result of a cell: one Parquet file, written once and whole."""

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from eval.consistency import Nees
from eval.errors import StudyError
from navcore.arrays import Floats
from navcore.odometry import BLOCKS, Run
from navcore.trajectory import Trajectory

SAVED_HZ = 5.0
"""About how many estimates a second are kept."""
_META = b"eval.record"
_AXES = ("x", "y", "z")
_STATE = {"p_WB": _AXES, "q_WB": ("x", "y", "z", "w"), "v_WB": _AXES, "b_g": _AXES, "b_a": _AXES}


@dataclass(frozen=True)
class Record:
    """What is kept of one run.

    Attributes:
        key, title, config, versions: of the cell.
        scores: flat numbers: those of `eval.metrics.score`, and completeness, start, times.
        failure: what the cell raised, or None.
        series: every few frames: `t_ns`, `t_s` from the first frame, health, tracked, used, the state, its
            standard deviations (`sigma_dtheta_x`...), NEES by block, and the truth (`true_p_WB_x`...).
            A value that nobody knows is missing.
        statements: what the source of bias priors said, as `eval.statements.tabulate` puts it.
    """

    key: str
    title: str
    config: dict[str, Any]
    versions: dict[str, str]
    scores: dict[str, float] = field(default_factory=dict)
    failure: str | None = None
    series: pd.DataFrame = field(default_factory=pd.DataFrame)
    statements: pd.DataFrame = field(default_factory=pd.DataFrame)

    def column(self, name: str) -> Floats:
        """(M, 3 or 4) of a vector of the series, as `p_WB`, `sigma_db_g` or `true_b_a`; NaN where missing."""
        names = [f"{name}_{axis}" for axis in (_STATE["q_WB"] if name.endswith("q_WB") else _AXES)]
        values: Floats = self.series[names].to_numpy(dtype=np.float64)
        return values


def path_of(folder: Path, key: str) -> Path:
    """Where the record of a cell is kept in a study's folder."""
    return folder / "cells" / f"{key}.parquet"


def write(record: Record, folder: Path) -> None:
    """Write a record; it appears whole or not at all, whoever is killed when."""
    path = path_of(folder, record.key)
    path.parent.mkdir(parents=True, exist_ok=True)
    head = {name: value for name, value in asdict(record).items() if name != "series"}
    head["statements"] = record.statements.to_dict("list")
    table = pa.Table.from_pandas(record.series, preserve_index=False)
    table = table.replace_schema_metadata({_META: json.dumps(head, allow_nan=False).encode()})
    partial = path.with_name(f".{path.name}.{uuid4().hex}.partial")  # a cell may run twice, on two machines
    try:
        pq.write_table(table, partial, compression="zstd")
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def read(path: Path) -> Record:
    """Read a record.

    Raises:
        StudyError: no such file, or not a record; the message names it.
    """
    if not path.is_file():
        raise StudyError(f"{path}: no such record of a cell")
    try:
        table = pq.read_table(path)
        head = json.loads(table.schema.metadata[_META])
        statements = pd.DataFrame(head.pop("statements"))
    except (pa.ArrowInvalid, KeyError, TypeError, ValueError) as error:
        raise StudyError(f"{path}: not a record of a cell: {error}") from error
    return Record(**head, series=table.to_pandas(), statements=statements)


def tabulate(run: Run, first_frame_ns: int, truth: Trajectory | None, nees: Nees | None) -> pd.DataFrame:
    """The series of a run, thinned by frame count so that all arms of a recording keep the same frames."""
    stamps = np.array([e.t_ns for e in run.estimates], dtype=np.int64)
    step_s = float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 1 else 1.0
    kept = np.arange(0, len(stamps), max(1, round(1.0 / (SAVED_HZ * step_s))))
    estimates = [run.estimates[k] for k in kept]
    columns: dict[str, Any] = {"t_ns": stamps[kept], "t_s": (stamps[kept] - first_frame_ns) * 1e-9}
    columns["health"] = [e.health.value for e in estimates]
    columns["tracked"] = [e.tracked for e in estimates]
    columns["used"] = [e.used for e in estimates]
    with_state = np.flatnonzero(run.has_state)
    rows = np.searchsorted(kept, with_state[np.isin(with_state, kept)])
    picked = np.flatnonzero(np.isin(with_state, kept))
    _spread(columns, "", run.trajectory[picked], rows, len(kept))
    for k, block in enumerate(BLOCKS):
        _place(columns, f"sigma_{block}", run.sigmas[picked, k], _AXES, rows, len(kept))
    if nees is not None:
        stamped = np.full((len(kept), len(BLOCKS)), np.nan)
        offset = len(with_state) - len(nees.values)
        late = picked >= offset
        stamped[rows[late]] = nees.values[picked[late] - offset]
        columns |= {f"nees_{block}": stamped[:, k].astype(np.float32) for k, block in enumerate(BLOCKS)}
    if truth is not None:
        known = np.flatnonzero(truth.covers(stamps[kept]))
        _spread(columns, "true_", truth.at(stamps[kept][known]), known, len(kept))
    return pd.DataFrame(columns)


def _spread(columns: dict[str, Any], prefix: str, path: Trajectory, rows: Any, length: int) -> None:
    """Add the columns of a path whose states belong to some of the rows."""
    for name, axes in _STATE.items():
        value = getattr(path, name)
        if value is not None:
            _place(columns, prefix + name, value, axes, rows, length)


def _place(columns: dict[str, Any], name: str, value: Floats, axes: tuple[str, ...], rows: Any, length: int) -> None:
    for k, axis in enumerate(axes):
        column = np.full(length, np.nan, dtype=np.float32)
        column[rows] = value[:, k]
        columns[f"{name}_{axis}"] = column

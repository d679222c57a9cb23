"""Files of labels: what `ipnet.recordings.read_labels` needs, and how each label was found."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.errors import LabelError
from ipnet.labels.label import Measured, SolvedLabel
from navcore.arrays import Floats
from navcore.sequence import Sequence


def row(solved: SolvedLabel, sequence: Sequence, source: str, by: str) -> dict[str, Any]:
    """What a file says of one label.

    Args:
        solved: the label.
        sequence: what it was found from.
        source: data set and owner, in words.
        by: what the IMU was held against, in words.
    """
    begin, end = solved.span_ns
    return {
        "sequence": solved.label.sequence,
        "b_g": _rounded(solved.label.bias[:3]),
        "b_a": _rounded(solved.label.bias[3:]),
        "covariance": [_rounded(x) for x in solved.label.covariance],
        "solver": solved.solver,
        "segments": {"used": solved.segments, "left_out": solved.left_out},
        "tilt_deg": _measured(solved.tilt, np.rad2deg(1.0)),
        "offset_ms": _measured(solved.offset, 1e3),
        "turn_deg": float(f"{np.rad2deg(solved.turn):.3g}"),
        "residual_rms": dict(zip(("gyro", "accelerometer"), _rounded(np.array(solved.rms)), strict=True)),
        "provenance": {
            "source": source,
            "truth": by,
            "span_ns": [begin, end],
            "seconds": round((end - begin) * 1e-9, 3),
            "imu_samples": len(sequence.imu.between(begin, end)),
        },
    }


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The rows of a file of labels; none if there is no file.

    Raises:
        LabelError: it is something else.
    """
    if not path.exists():
        return []
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        named = {str(r["sequence"]): dict(r) for r in rows}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise LabelError(f"{path}: {error!r}; expected a file of labels, or none") from error
    return list(named.values())


def write_rows(path: Path, rows: Iterable[dict[str, Any]]) -> None:
    """Write a file of labels; it appears whole or not.

    Raises:
        LabelError: it cannot be written.
    """
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(json.dumps(list(rows), indent=1, allow_nan=False) + "\n", encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise LabelError(f"{path}: cannot be written: {error}") from error


def _measured(measured: Measured | None, unit: float) -> dict[str, list[float]] | None:
    if measured is None:
        return None
    return {"value": _rounded(unit * measured.value), "sigma": _rounded(unit * measured.sigma)}


def _rounded(values: Floats) -> list[float]:
    return [float(f"{x:.8g}") for x in values]

"""Tables by time: `t_ns,value,value,...`, read fast, and explained line by line when they are wrong."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import islice
from math import isinf, isnan
from pathlib import Path
from typing import TextIO

import numpy as np

from navcore.arrays import Floats, Stamps
from navcore.errors import DataError


def read_table(
    path: Path, columns: int, expected: str, nan_columns: Collection[int] = (), repeats: bool = False
) -> tuple[Stamps, Floats]:
    """Stamps and values of a CSV whose rows are an integer stamp [ns] and `columns` numbers.

    Blank lines and comments (`#`) are skipped, and so is a first line without any number (a header).

    Args:
        path: the file.
        columns: how many numbers follow the stamp.
        expected: what a row holds, for messages.
        nan_columns: indices of the values that may be NaN.
        repeats: whether consecutive rows may share a stamp.

    Returns:
        (N,) int64 ns, every digit kept, and (N, columns) float64.

    Raises:
        DataError: the file is missing or empty, or a row has the wrong number of fields, something that is no
            finite number, or a stamp that does not follow the last one. The message has file and line.
    """
    count_columns(path, expected)
    table = _Table(path, columns, expected, frozenset(nan_columns), repeats)
    row = np.dtype([("t_ns", np.int64), ("values", np.float64, (columns,))])
    header = _header_lines(path, expected)
    try:
        with _open(path) as lines:
            body = islice(lines, header, None)
            rows = np.loadtxt(body, dtype=row, delimiter=",", ndmin=1, converters={0: int})
    except (ValueError, OverflowError) as error:
        raise table.first_fault(str(error)) from error
    t_ns: Stamps = np.ascontiguousarray(rows["t_ns"])
    values: Floats = np.ascontiguousarray(rows["values"])
    strict = [k for k in range(columns) if k not in table.nan_columns]
    finite = np.isfinite(values[:, strict]).all() and not np.isinf(values).any()
    if not finite or np.any(np.diff(t_ns) < (0 if repeats else 1)):
        raise table.first_fault("a value or a stamp is wrong")
    return t_ns, values


def read_names(path: Path, expected: str) -> list[tuple[int, str]]:
    """Rows of an integer stamp [ns], strictly increasing, and a name.

    Raises:
        DataError: the file is missing, or a row is something else; the message has file and line.
    """
    found: list[tuple[int, str]] = []
    for number, fields in _rows(path, expected):
        if len(fields) != 2 or not fields[1] or not _is_integer(fields[0]):
            raise DataError(f"{path}:{number}: expected {expected}, got {','.join(fields)!r}")
        t_ns = int(fields[0])
        fault = _order_fault(found[-1][0], t_ns) if found else None
        if fault:
            raise DataError(f"{path}:{number}: {fault}")
        found.append((t_ns, fields[1]))
    return found


def count_columns(path: Path, expected: str) -> int:
    """How many numbers follow the stamp in the first row of a table.

    Raises:
        DataError: the file is missing or has no rows.
    """
    for _, fields in _rows(path, expected):
        return len(fields) - 1
    raise DataError(f"{path}: no rows; expected {expected}")


@dataclass(frozen=True)
class _Table:
    """What a table should be, to say where it is not."""

    path: Path
    columns: int
    expected: str
    nan_columns: frozenset[int]
    repeats: bool

    def first_fault(self, otherwise: str) -> DataError:
        """The first wrong line of the file, as an error."""
        before: int | None = None
        for number, fields in _rows(self.path, self.expected):
            fault = self._row_fault(fields)
            if fault is None and before is not None:
                fault = _order_fault(before, int(fields[0]), self.repeats)
            if fault is not None:
                return DataError(f"{self.path}:{number}: {fault}")
            before = int(fields[0])
        return DataError(f"{self.path}: {otherwise}; expected {self.expected}")

    def _row_fault(self, fields: list[str]) -> str | None:
        if len(fields) != self.columns + 1:
            return f"{len(fields)} fields, expected {self.columns + 1}: {self.expected}"
        if not _is_integer(fields[0]):
            return f"stamp {fields[0]!r} is not a whole number of nanoseconds; expected {self.expected}"
        for k, field in enumerate(fields[1:]):
            value = _number(field)
            if value is None or isinf(value) or (isnan(value) and k not in self.nan_columns):
                return f"field {k + 2} is {field!r}, expected a finite number: {self.expected}"
        return None


def _order_fault(before: int, t_ns: int, repeats: bool = False) -> str | None:
    if t_ns == before and not repeats:
        return f"stamp {t_ns} ns is repeated; expected stamps that increase"
    if t_ns < before:
        return f"stamp {t_ns} ns is out of order, it comes after {before} ns; expected stamps that increase"
    return None


def _open(path: Path) -> TextIO:
    return path.open(encoding="utf-8-sig", errors="replace")


def _header_lines(path: Path, expected: str) -> int:
    """1 if the first line is a header without `#`: it has text and no number."""
    if not path.is_file():
        raise DataError(f"{path}: no such file; expected rows of {expected}")
    with _open(path) as lines:
        first = lines.readline().strip()
    is_text = first != "" and not first.startswith("#") and all(_number(x) is None for x in first.split(","))
    return 1 if is_text else 0


def _rows(path: Path, expected: str) -> Iterator[tuple[int, list[str]]]:
    """Line numbers from 1 and stripped fields."""
    header = _header_lines(path, expected)
    with _open(path) as lines:
        for number, line in enumerate(lines, 1):
            text = line.partition("#")[0].strip()
            if text and number > header:
                yield number, [x.strip() for x in text.split(",")]


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _is_integer(text: str) -> bool:
    return text.removeprefix("-").isdecimal() and abs(int(text)) < 2**63

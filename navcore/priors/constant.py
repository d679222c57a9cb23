"""`constant:FILE.json`: what earlier recordings say of this device, as its initial biases."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from navcore.arrays import Floats
from navcore.errors import ConfigError, DataError
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.priors.listed import ListedPrior
from navcore.sequence import Sequence

_KEYS = ("b_g", "b_a", "covariance")
_FROM = "recordings"
_EXPECTED = "b_g (3 rad/s), b_a (3 m/s^2), covariance (6x6, or 6 variances) of b_g, b_a"


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """A source that offers the file's biases and covariance as `device()`, and no measurement.

    Raises:
        ConfigError: no file is named.
        DataError: the file is missing, is not JSON, or its keys or shapes are not `b_g, b_a, covariance`.
    """
    if not argument:
        raise ConfigError("bias prior 'constant' needs a file: constant:FILE.json")
    path = Path(argument)
    content = _load(path)
    b_g, b_a = _numbers(path, content, "b_g", (3,)), _numbers(path, content, "b_a", (3,))
    covariance = _covariance(path, content)
    t_ns = 0 if sequence is None else int(sequence.imu.t_ns[0])
    try:
        return ListedPrior(device=BiasPrior(t_ns, b_g, b_a, covariance))
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def learned_from(argument: str) -> tuple[str, ...]:
    """Names of the recordings that a file's values were learned from, as far as it says: its `recordings`.

    Raises:
        DataError: as `make`.
    """
    return tuple(_load(Path(argument)).get(_FROM, ()))


def _load(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise DataError(f"{path}: no such file; expected JSON with {_EXPECTED}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise DataError(f"{path}: not JSON: {error}; expected {_EXPECTED}") from error
    if not isinstance(content, dict) or set(content) - {_FROM} != set(_KEYS):
        got = sorted(content) if isinstance(content, dict) else type(content).__name__
        raise DataError(f"{path}: keys are {got}, expected exactly {_EXPECTED}; beside them {_FROM} may be")
    names = content.get(_FROM, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise DataError(f"{path}: {_FROM} is {names!r}, expected a list of names")
    return content


def _covariance(path: Path, content: dict[str, Any]) -> Floats:
    """(6, 6) from a matrix or from six variances."""
    if np.shape(content["covariance"]) == (6,):
        return np.diag(_numbers(path, content, "covariance", (6,)))
    return _numbers(path, content, "covariance", (6, 6))


def _numbers(path: Path, content: dict[str, Any], key: str, shape: tuple[int, ...]) -> Floats:
    try:
        value = np.array(content[key], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{path}: {key} does not hold numbers; expected {_EXPECTED}") from error
    if value.shape != shape:
        raise DataError(f"{path}: {key} has shape {value.shape}, expected {shape}: {_EXPECTED}")
    return value

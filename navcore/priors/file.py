"""`file:FILE.csv`: measurements that any other program has made, `t_ns, b_g(3), b_a(3), sigma(6)` a row.

Options follow the name as in an address: `file:FILE.csv?window=20&constant_share=0.3`.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from navcore.errors import ConfigError, DataError
from navcore.prior import BiasPrior, BiasPriorSource
from navcore.priors.listed import ListedPrior
from navcore.readers.table import read_table
from navcore.sequence import Sequence

_ROW = "t_ns, b_g x y z [rad/s], b_a x y z [m/s^2], sigma of the six"


@dataclass(frozen=True)
class FileOptions:
    """How the rows are to be understood.

    Attributes:
        window: length of the IMU window behind a row [s]; a row is available half of it after its stamp.
        constant_share: share of a row's variance that does not change over a run. A file says how wrong a row
            is, not how much of that repeats in the next one; an even split is for want of better knowledge.
    """

    window: float = 5.0
    constant_share: float = 0.5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.window) and self.window >= 0.0):
            raise ConfigError(f"window is {self.window}, expected seconds, not negative")
        if not 0.0 <= self.constant_share < 1.0:
            raise ConfigError(f"constant_share is {self.constant_share}, expected 0 <= share < 1")


def make(argument: str, sequence: Sequence | None) -> BiasPriorSource:
    """A source that gives the file's rows as measurements.

    The variance of a row is split: `constant_share` of the median one is the constant error `c`, the rest of
    each row's own is the short-lived `e`.

    Raises:
        ConfigError: no file is named, or an option is unknown or out of range.
        DataError: the file is missing or a row is wrong.
    """
    name, _, text = argument.partition("?")
    if not name:
        raise ConfigError("bias prior 'file' needs a file: file:FILE.csv")
    options = _options(text)
    path = Path(name)
    t_ns, values = read_table(path, 12, _ROW)
    sigma = values[:, 6:]
    if not (sigma > 0.0).all():
        k = int(np.argmin((sigma > 0.0).all(axis=1)))
        raise DataError(f"{path}: sigma at {t_ns[k]} ns is {sigma[k]}, expected six positive numbers")
    e = (1.0 - options.constant_share) * sigma**2
    c = np.diag(options.constant_share * np.median(sigma, axis=0) ** 2)
    rows = [
        BiasPrior(t, b[:3], b[3:], np.diag(variance))
        for t, b, variance in zip(t_ns.tolist(), values[:, :6], e, strict=True)
    ]
    return ListedPrior(rows, window_s=options.window, constant_covariance=c)


def _options(text: str) -> FileOptions:
    """Options from `key=value&key=value`."""
    known = tuple(FileOptions.__dataclass_fields__)
    values: dict[str, float] = {}
    for item in filter(None, text.split("&")):
        key, _, value = item.partition("=")
        if key not in known:
            raise ConfigError(f"option {key!r} of bias prior 'file' is unknown; known are {', '.join(known)}")
        try:
            values[key] = float(value)
        except ValueError as error:
            raise ConfigError(f"option {key} of bias prior 'file' is {value!r}, expected a number") from error
    return FileOptions(**values)

"""What a source of bias priors says during a run, word for word, beside what an estimator makes of it."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from navcore.arrays import Floats
from navcore.imu import ImuSamples
from navcore.prior import BiasPrior, BiasPriorSource

AXES = ("x", "y", "z")
_APART_S = 0.2  # between two statements that are kept
_DIGITS = 6


class Overheard:
    """A source that is passed on as it is; `statements` are the measurements that it has given."""

    def __init__(self, source: BiasPriorSource) -> None:
        self.window_s = source.window_s
        self.constant_covariance = source.constant_covariance
        self.statements: list[BiasPrior] = []
        self._source = source

    def device(self) -> BiasPrior | None:
        """What is known of this device before it moves."""
        return self._source.device()

    def add_imu(self, samples: ImuSamples) -> None:
        """Take new samples, in time order."""
        self._source.add_imu(samples)

    def poll(self, t_ns: int) -> list[BiasPrior]:
        """The measurements that became available up to IMU time `t_ns`, each given once, in time order."""
        new = self._source.poll(t_ns)
        self.statements += new
        return new


def tabulate(statements: Iterable[BiasPrior], constant: Floats, first_ns: int) -> pd.DataFrame:
    """A row for each statement, at most five a second: `t_ns`, `t_s` from `first_ns`, `b_g_x`..., `sigma_db_g_x`...

    Args:
        statements: in time order.
        constant: (6, 6) covariance of `c`; sigma is that of the whole error, `c` and `e`.
        first_ns: stamp of the first frame.
    """
    names = [f"{name}_{axis}" for name in ("b_g", "b_a") for axis in AXES]
    kept: list[BiasPrior] = []
    for statement in statements:
        if not kept or statement.t_ns - kept[-1].t_ns >= _APART_S * 1e9:
            kept.append(statement)
    t_ns = np.array([s.t_ns for s in kept], dtype=np.int64)
    values = np.array([s.vector for s in kept]).reshape(-1, 6)
    sigmas = np.sqrt(np.array([np.diagonal(s.covariance + constant) for s in kept])).reshape(-1, 6)
    table = pd.DataFrame({"t_ns": t_ns, "t_s": (t_ns - first_ns) * 1e-9})
    for k, name in enumerate(names):
        table[name] = [_short(v) for v in values[:, k]]
        table[name.replace("b_", "sigma_db_")] = [_short(v) for v in sigmas[:, k]]
    return table


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")

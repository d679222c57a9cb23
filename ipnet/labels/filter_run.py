"""A filter's own path in place of the truth, where the filter rates it good: labels without motion capture."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ipnet.errors import LabelError
from navcore.arrays import Floats, Mask, Stamps, frozen
from navcore.odometry import Health
from navcore.results import read_run
from navcore.results.folder import FRAMES
from navcore.trajectory import Trajectory

START_UP_S = 10.0
"""Poses this soon after the first are left out: scale and biases are still being found."""
AFTER_LOSS_S = 5.0
"""So are those this soon after a frame in which the filter did not track."""
FEWEST_FEATURES = 20
"""And those of frames in which fewer features were followed."""


@dataclass(frozen=True)
class GoodPath:
    """The good poses of a run, and what they lean on.

    A filter's poses do not err each by itself: its attitude leans as far as its accelerometer bias is wrong, and
    turns as its gyro bias is. IMU and path then agree about that wrong bias in every segment, and no number of
    segments averages it out. So a label is no surer than the filter was.

    Attributes:
        poses: causal.
        sigma: (6,) rms over them of the standard deviations that the filter gave its b_g [rad/s] and b_a [m/s^2].
    """

    poses: Trajectory
    sigma: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", frozen("sigma", self.sigma, np.float64, (6,)))


def good_path(folder: Path) -> GoodPath:
    """The causal poses of a run, less those that its filter rates poor.

    Args:
        folder: as `python -m msckf run` writes it.

    Raises:
        DataError: it holds no run.
        LabelError: its frames cannot be read, or none is good.
    """
    run = read_run(folder)
    t_ns, tracking, tracked = _frames(folder / FRAMES)
    good = tracking & (tracked >= FEWEST_FEATURES)
    if tracking.any():
        first = t_ns[tracking][0]
        poor = t_ns[~tracking & (t_ns > first)]
        before = np.concatenate([[-(2**62)], poor])[np.searchsorted(poor, t_ns, side="right")]
        good &= (t_ns - first >= START_UP_S * 1e9) & (t_ns - before >= AFTER_LOSS_S * 1e9)
    kept = np.isin(run.trajectory.t_ns, t_ns[good])
    if not kept.any():
        raise LabelError(
            f"{folder}: none of {len(kept)} poses is good: {START_UP_S:g} s after the start, {AFTER_LOSS_S:g} s "
            f"after a loss, with {FEWEST_FEATURES} features or more"
        )
    return GoodPath(run.trajectory[kept], np.sqrt(np.mean(run.sigma[kept] ** 2, axis=0)))


def _frames(path: Path) -> tuple[Stamps, Mask, Stamps]:
    """Stamps, whether the filter tracked, and how many features."""
    if not path.is_file():
        raise LabelError(f"{path}: no such file; expected the folder of a run")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    try:
        t_ns = np.array([int(r["t_ns"]) for r in rows], dtype=np.int64)
        tracking = np.array([r["health"] == Health.TRACKING.value for r in rows], dtype=bool)
        return t_ns, tracking, np.array([int(r["tracked"]) for r in rows], dtype=np.int64)
    except (KeyError, ValueError) as error:
        raise LabelError(f"{path}: {error!r}; expected columns t_ns, health and tracked") from error

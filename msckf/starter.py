"""Before there is a state: frames are collected until the rig stands still, or its motion tells the state."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from msckf.config import FilterConfig
from msckf.features import FeatureTable
from msckf.moving_start import StartResult, moving_start
from msckf.prior_update import StartingBias
from msckf.start_inertia import Window
from msckf.static_start import force_surprise, is_steady, static_start
from msckf.views import Rig
from navcore.arrays import Mask, Stamps, Vectors, among
from navcore.calibration import Calibration
from navcore.frontend import Observations
from navcore.imu_buffer import ImuBuffer
from navcore.odometry import State
from navcore.stillness import image_motion

_ATTEMPT_S = 0.2  # between attempts of a moving start
_MAX_SURPRISE = 4.0  # standard deviations by which the force at rest may differ from gravity


@dataclass(frozen=True)
class Start:
    """A start, or why there is none yet.

    Attributes:
        state: to start from.
        reason: empty if there is one.
        rough: what fits, but is not known well enough to start from.
    """

    state: State | None
    reason: str
    rough: State | None = None


class Starter:
    """Collects frames and finds the first state."""

    def __init__(self, calibration: Calibration, rig: Rig, config: FilterConfig) -> None:
        self._noise = calibration.imu
        self._rig = rig
        self._config = config
        self._table = FeatureTable(len(rig))
        self._t_ns: list[int] = []
        self._last_attempt_ns: int | None = None
        self._last_reason = "collecting images"
        self._gyro_bias: Vectors | None = None  # what the last window said of it

    def attempt(self, t_ns: int, observations: Observations, buffer: ImuBuffer, bias: StartingBias) -> Start:
        """Take the observations of a frame at IMU time `t_ns` and try to start there."""
        c = self._config.start
        if buffer.oldest_ns is None or buffer.oldest_ns > t_ns:
            return Start(None, "no IMU yet")
        self._table.add_clone(observations)
        self._t_ns.append(t_ns)
        keep_ns = round(1.1e9 * max(c.moving_s, c.static_s))
        while self._t_ns[0] < t_ns - keep_ns:
            self._t_ns.pop(0)
            self._table.drop_clone(0)
        if c.mode in ("auto", "static"):
            start = self._static(t_ns, buffer, bias)
            if start.state is not None or c.mode == "static":
                return start
        return self._moving(t_ns, buffer, bias)

    def _static(self, t_ns: int, buffer: ImuBuffer, bias: StartingBias) -> Start:
        c = self._config
        begin_ns = t_ns - round(c.start.static_s * 1e9)
        if self._t_ns[0] > begin_ns + 1_000_000 or (buffer.oldest_ns or 0) > begin_ns + 10_000_000:
            return Start(None, "collecting images")
        _, gyro, accel = buffer.samples(begin_ns, t_ns)
        if not is_steady(gyro, accel, self._noise.rate_hz, c.standstill):
            return Start(None, "not standing still")
        k = int(np.searchsorted(self._t_ns, begin_ns - 1_000_000))
        moved = image_motion(*self._table.followed(k, self._table.clones - 1))
        if moved is None:
            return Start(None, "too few features are followed")
        if moved > c.start.static_disparity:
            return Start(None, "not standing still")
        if force_surprise(accel, bias.device) > _MAX_SURPRISE:
            return Start(None, "the force at rest is not gravity")
        return Start(static_start(gyro, accel, self._noise, bias.device), "")

    def _moving(self, t_ns: int, buffer: ImuBuffer, bias: StartingBias) -> Start:
        c = self._config.start
        keyframes = self._keyframes(t_ns)
        if keyframes is None:
            return Start(None, "collecting images")
        if self._last_attempt_ns is not None and t_ns - self._last_attempt_ns < _ATTEMPT_S * 1e9 - 1e6:
            return Start(None, self._last_reason)
        self._last_attempt_ns = t_ns
        seen_from = self._table.seen_from[:, keyframes]
        rows = self._chosen(seen_from.sum(axis=1), seen_from[:, -1])
        views = self._table.views_of(self._rig, rows, np.array(keyframes))
        times = [self._t_ns[k] for k in keyframes]
        cells = [buffer.cells(a, b) for a, b in pairwise(times)]
        window = Window(cells, views, self._noise, bias.device)
        try:
            result = moving_start(window, c, self._config.vision.pixel_noise, self._gyro_bias)
        except np.linalg.LinAlgError:
            result = StartResult(None, "motion does not determine the state")
        self._gyro_bias = result.b_g if result.b_g is not None else self._gyro_bias
        self._last_reason = result.reason
        return Start(result.state, result.reason, result.rough)

    def _chosen(self, count: Stamps, alive: Mask) -> Stamps:
        """Features (F,) that were seen longest: most of those that are still followed, some that are not."""
        most = self._config.start.features
        known = np.flatnonzero(count >= self._config.vision.min_views)
        known = known[np.argsort(-count[known], kind="stable")]
        first = known[alive[known]][: 2 * most // 3]
        others = known[~among(known, first)][: most - len(first)]
        return np.sort(np.concatenate([first, others]))

    def _keyframes(self, t_ns: int) -> list[int] | None:
        """Poses evenly apart, that end with the newest and go back as far as they may; None if there are too few."""
        c = self._config.start
        times = np.array(self._t_ns)
        reach_s = min((t_ns - times[0]) * 1e-9, c.moving_s)
        if reach_s < c.least_moving_s - 0.5 * c.keyframe_s:
            return None
        step_s = max(c.keyframe_s, reach_s / (c.poses - 1))
        wanted = t_ns - np.arange(int(reach_s / step_s + 0.5), -1, -1) * round(step_s * 1e9)
        columns = sorted({int(np.argmin(np.abs(times - w))) for w in wanted})
        return columns if len(columns) >= 5 else None

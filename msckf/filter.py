"""The filter as its users see it: IMU samples and frames in, estimates out."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from msckf.blocks import POSITION, VELOCITY
from msckf.clock import stage
from msckf.config import FilterConfig
from msckf.errors import InputError
from msckf.estimated import Estimated
from msckf.frontend import Frontend, Observations
from msckf.health import HealthMonitor
from msckf.imu_buffer import ImuBuffer
from msckf.prior_update import PriorState, PriorUpdate, StartingBias
from msckf.propagation import integrate
from msckf.standstill import imu_is_quiet, standstill_update
from msckf.starter import Starter
from msckf.state import FilterState
from msckf.views import Rig
from msckf.visual import VisualOutcome
from msckf.window import VisualWindow
from navcore import so3
from navcore.arrays import Rotations, Vectors
from navcore.calibration import Calibration
from navcore.errors import ConfigError
from navcore.imu import ImuSamples
from navcore.odometry import Estimate, Health, State
from navcore.prior import BiasPriorSource, load_prior
from navcore.sequence import Frame, Tracks


@dataclass(frozen=True)
class TimedState:
    """A state that the filter is told to start from, at IMU time `t_ns`."""

    t_ns: int
    state: State


class Filter:
    """An MSCKF for one IMU and one or more cameras. Implements `navcore.odometry.Odometry`.

    Args:
        calibration: of the rig.
        config: settings.
        prior: where bias priors come from; None is the source `none`.
        start: a state to start from, instead of finding one.

    Raises:
        ConfigError: the rig has fewer cameras than the config asks for.
    """

    def __init__(
        self,
        calibration: Calibration,
        config: FilterConfig | None = None,
        prior: BiasPriorSource | None = None,
        start: TimedState | None = None,
    ) -> None:
        self.config = config or FilterConfig()
        self.calibration = calibration
        if not 1 <= self.config.cameras <= len(calibration.cameras):
            raise ConfigError(f"{self.config.cameras} cameras asked for, the rig has {len(calibration.cameras)}")
        self._rig = Rig(calibration.cameras[: self.config.cameras])
        self._buffer = ImuBuffer(calibration.imu.rate_hz)
        self._frames: deque[Frame] = deque()
        self._newest_frame_ns: int | None = None
        self._frontend = Frontend(self._rig, self.config.tracker)
        self._observations: Observations | None = None
        self._prior = PriorUpdate(prior or load_prior("none"), self.config.prior, calibration.imu)
        self._told_start = start
        self._start_bias: StartingBias | None = None
        self._last_pose: tuple[Rotations, Vectors] | None = None
        self._begin_anew()

    def _begin_anew(self) -> None:
        self.state: FilterState | None = None
        self._omega_B = np.zeros(3)
        self._t_ns: int | None = None
        self._window = VisualWindow(len(self._rig), self.config.vision)
        self._starter = Starter(self.calibration, self._rig, self.config)
        self._health = HealthMonitor(self.config.health)

    # -- what it knows, to look at ---------------------------------------------------------------------------------

    @property
    def tracks(self) -> Mapping[int, Tracks]:
        """What each camera followed into the newest frame that was answered, by camera index."""
        return {} if self._observations is None else self._observations.tracks()

    @property
    def prior(self) -> PriorState:
        """What it knows of its bias prior."""
        return self._prior.known(self.state)

    # -- input ------------------------------------------------------------------------------------------------

    def add_imu(self, samples: ImuSamples) -> list[Estimate]:
        """Take samples that follow all earlier ones in time; returns the estimates that they complete.

        Raises:
            InputError: they do not follow; the filter is as it was.
        """
        self._buffer.append(samples)
        self._prior.add_imu(samples)
        return self._answer(final=False)

    def add_frame(self, frame: Frame) -> list[Estimate]:
        """Take the next frame; its estimate comes when the IMU covers it.

        Raises:
            InputError: the frame is not newer than the last; the filter is as it was.
        """
        if self._newest_frame_ns is not None and frame.t_ns <= self._newest_frame_ns:
            raise InputError(f"frame at {frame.t_ns} ns does not follow the last, at {self._newest_frame_ns} ns")
        self._newest_frame_ns = frame.t_ns
        self._frames.append(frame)
        return self._answer(final=False)

    def finish(self) -> list[Estimate]:
        """No more input comes: estimates for the frames that were still waiting for the IMU."""
        return self._answer(final=True)

    def _answer(self, *, final: bool) -> list[Estimate]:
        estimates = []
        while self._frames:
            t_ns = self._frames[0].t_ns + self._offset_ns()
            newest = self._buffer.newest_ns
            reach = 0 if newest is None else newest
            if newest is None or reach < t_ns:
                if not final:
                    break
                if newest is None or t_ns - reach > round(1e9 * self.config.health.max_imu_gap_s):
                    self._frames.popleft()
                    estimates.append(Estimate(t_ns, Health.LOST, ("no IMU up to this frame",)))
                    continue
            estimates.append(self._process(self._frames.popleft(), t_ns))
        return estimates

    def _offset_ns(self) -> int:
        """From camera time to IMU time, as far as it is known."""
        offset_s = self._rig.mounts[0].dt_cam_imu if self.state is None else self.state.dt_cam_imu
        return round(offset_s * 1e9)

    # -- one frame --------------------------------------------------------------------------------------------

    def _process(self, frame: Frame, t_ns: int) -> Estimate:
        stages: dict[str, float] = {}
        try:
            if self.state is None:
                return self._try_to_start(frame, t_ns, stages)
            return self._follow(frame, t_ns, stages)
        except np.linalg.LinAlgError as error:  # a covariance that rounding has spoiled must not end the run
            self._begin_anew()
            return Estimate(t_ns, Health.LOST, (f"numerical failure ({error})",), None, 0, 0, stages)

    def _follow(self, frame: Frame, t_ns: int, stages: dict[str, float]) -> Estimate:
        assert self.state is not None
        with stage(stages, "propagate"):
            R_before = self.state.R_WB
            notes = self._propagate(self.state, t_ns)
            R_B1B0 = self.state.R_WB.T @ R_before
        observations = self._observations = self._frontend.observe(frame, R_B1B0, stages)
        with stage(stages, "update"):
            outcome, still = self._correct(self.state, frame.t_ns, t_ns, observations)
        with stage(stages, "prior"):
            notes += self._prior.update(self.state, t_ns)
        verdict = self._health.judge(self.state, t_ns, observations, outcome, still)
        self._buffer.drop_before(t_ns - round(1e9 * self.config.standstill.window_s))
        reasons = notes + verdict.reasons
        if verdict.health is Health.LOST:
            self._begin_anew()
            return Estimate(t_ns, Health.LOST, reasons, None, len(observations), 0, stages)
        self._last_pose = (self.state.R_WB, self.state.p_WB)
        return Estimate(t_ns, verdict.health, reasons, self.state.snapshot(), len(observations), outcome.used, stages)

    def _propagate(self, state: FilterState, t_ns: int) -> tuple[str, ...]:
        assert self._t_ns is not None
        cells = self._buffer.cells(self._t_ns, t_ns)
        state.propagate(integrate(cells, state.b_g, state.b_a, self.calibration.imu))
        if len(cells.gyro):
            self._omega_B = cells.gyro[-1] - state.b_g
        self._t_ns = t_ns
        gap = float(cells.bridged.sum())
        self._health.note_gap(gap)
        return (f"IMU gap of {gap:.3f} s",) if gap > self.config.health.max_imu_gap_s else ()

    def _correct(
        self, state: FilterState, frame_ns: int, t_ns: int, observations: Observations
    ) -> tuple[VisualOutcome, bool]:
        """Standstill or visual update; says whether the body stands still."""
        c = self.config.standstill
        if c.enabled and len(state.clones) and imu_is_quiet(self._buffer, t_ns, c, c.window_s):
            disparity = self._window.disparity(observations)
            if disparity is not None and disparity < c.max_disparity:
                standstill_update(state, c)
                self._window.hold(observations)
                return VisualOutcome(), True
        return self._window.advance(state, frame_ns, self._omega_B, observations), False

    # -- start ------------------------------------------------------------------------------------------------

    def _try_to_start(self, frame: Frame, t_ns: int, stages: dict[str, float]) -> Estimate:
        observations = self._observations = self._frontend.observe(frame, None, stages)
        with stage(stages, "start"):
            state, reason = self._find_start(t_ns, observations)
        health = Health.INITIALISING if self._last_pose is None else Health.LOST
        if state is None:
            horizon = 2.0 * max(self.config.start.moving_s, self.config.start.static_s)
            self._buffer.drop_before(t_ns - round(1e9 * horizon))
            return Estimate(t_ns, health, (reason, *observations.faults), None, len(observations), 0, stages)
        if self._last_pose is not None:
            state = continued(state, *self._last_pose)
        self.state = self._begun(state)
        estimated = Estimated.of(self.config.calibration)
        self.state.estimate_calibration(estimated, estimated.sigmas(self.config.calibration, len(self._rig)))
        if self._start_bias is not None:
            self._prior.begin(self.state, self._start_bias)
        self._t_ns = t_ns
        self._health.started(t_ns)
        self._last_pose = (self.state.R_WB, self.state.p_WB)
        return Estimate(t_ns, Health.TRACKING, ("started",), self.state.snapshot(), len(observations), 0, stages)

    def _begun(self, state: State) -> FilterState:
        return FilterState(state, self._rig, self._rig.mounts[0].dt_cam_imu, fej=self.config.vision.fej)

    def _find_start(self, t_ns: int, observations: Observations) -> tuple[State | None, str]:
        self._start_bias = self._prior.starting_bias(self.config.start, t_ns)
        told = self._told_start
        if told is not None:
            if told.t_ns > t_ns or (self._buffer.oldest_ns or 0) > told.t_ns:
                return None, "before the time of the given start"
            self._told_start = None
            s = self._begun(told.state)
            cells = self._buffer.cells(told.t_ns, t_ns)
            s.propagate(integrate(cells, s.b_g, s.b_a, self.calibration.imu))
            return s.snapshot(), ""
        start = self._starter.attempt(t_ns, observations, self._buffer, self._start_bias)
        return start.state, start.reason


def continued(state: State, R_last: Rotations, p_last: Vectors) -> State:
    """A new start, turned and moved so that heading and position go on from the last pose."""

    def heading(R_WB: Rotations) -> float:
        return float(np.arctan2(R_WB[1, 0], R_WB[0, 0]))

    turn = so3.exp(np.array([0.0, 0.0, heading(R_last) - heading(state.R_WB)]))
    T = np.eye(15)
    T[POSITION, POSITION] = T[VELOCITY, VELOCITY] = turn
    return replace(
        state,
        R_WB=turn @ state.R_WB,
        p_WB=p_last.copy(),
        v_WB=turn @ state.v_WB,
        covariance=T @ state.covariance @ T.T,
    )


def make(
    calibration: Calibration,
    prior: BiasPriorSource,
    overrides: Mapping[str, Any],
    start: TimedState | None = None,
) -> Filter:
    """Entry point `navcore.odometry: msckf`: a filter whose settings are `overrides` of the defaults by dotted name."""
    return Filter(calibration, FilterConfig().with_overrides(overrides), prior, start)

"""The filter as its users see it: IMU samples and frames in, estimates out."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from msckf.config import FilterConfig
from msckf.estimated import Estimated
from msckf.health import HealthMonitor, Verdict
from msckf.prior_update import PriorUpdate, StartingBias
from msckf.propagation import integrate
from msckf.recovery import Memory, disagreement
from msckf.standstill import standstill_update
from msckf.starter import Starter
from msckf.state import FilterState
from msckf.views import Rig
from msckf.visual import VisualOutcome
from msckf.window import VisualWindow
from navcore.arrays import Floats, Rotations
from navcore.calibration import Calibration
from navcore.chi_square import chi_square_quantile
from navcore.clock import stage
from navcore.errors import ConfigError
from navcore.frontend import Frontend, Observations
from navcore.imu import ImuNoise, ImuSamples
from navcore.imu_buffer import Cells
from navcore.inbox import Inbox
from navcore.last_pose import LastPose, continued
from navcore.odometry import Estimate, Health, State, TimedState
from navcore.prior import BiasPriorSource, PriorState, load_prior
from navcore.sequence import Frame, Tracks
from navcore.stillness import imu_is_quiet
from navcore.vibration import WINDOW_S, noise_under_vibration

_SAME_STATE = 0.999  # quantile of the chi-square test by which two states are the same


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
        health = self.config.health
        self._inbox = Inbox(calibration.imu.rate_hz, health.max_ahead_s, health.max_imu_gap_s)
        self._buffer = self._inbox.buffer
        self._frontend = Frontend(self._rig.mounts, self.config.tracker)
        self._observations: Observations | None = None
        self._prior = PriorUpdate(prior or load_prior("none"), self.config.prior, calibration.imu)
        self._told_start = start
        self._start_bias: StartingBias | None = None
        self._last_pose: LastPose | None = None
        self._memory = Memory()
        self._begin_anew()

    def _begin_anew(self) -> None:
        self.state: FilterState | None = None
        self._omega_B = np.zeros(3)
        self._t_ns: int | None = None
        self._window = VisualWindow(len(self._rig), self.config.vision)
        self._starter = self._new_starter()
        self._rival: Starter | None = None  # looks for another state while vision contradicts this one
        self._health = HealthMonitor(self.config.health)

    def _new_starter(self) -> Starter:
        return Starter(self.calibration, self._known_rig, self.config)

    @property
    def _known_rig(self) -> Rig:
        """The cameras as calibrated, or as learned since."""
        learned = self._memory.learned
        return self._rig if learned is None else learned.rig

    @property
    def _known_offset_s(self) -> float:
        learned = self._memory.learned
        return self._rig.mounts[0].dt_cam_imu if learned is None else learned.dt_cam_imu

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
        self._inbox.add_imu(samples)
        self._prior.add_imu(samples)
        return self._answer(final=False)

    def add_frame(self, frame: Frame) -> list[Estimate]:
        """Take the next frame; its estimate comes when the IMU covers it.

        Raises:
            InputError: the frame is not newer than the last, or so far ahead that its stamp must be wrong; the
                estimate is as it was. A second frame that follows one refused for being ahead is taken.
        """
        self._inbox.add_frame(frame)
        return self._answer(final=False)

    def finish(self) -> list[Estimate]:
        """No more input comes: estimates for the frames that were still waiting for the IMU."""
        return self._answer(final=True)

    def _answer(self, *, final: bool) -> list[Estimate]:
        estimates = []
        while (due := self._inbox.next(self._offset_ns(), final=final)) is not None:
            if due.covered:
                estimates.append(self._process(due.frame, due.t_ns))
            else:
                estimates.append(Estimate(due.t_ns, Health.LOST, ("no IMU up to this frame",)))
        return estimates

    def _offset_ns(self) -> int:
        """From camera time to IMU time, as far as it is known."""
        offset_s = self._known_offset_s if self.state is None else self.state.dt_cam_imu
        return round(offset_s * 1e9)

    # -- one frame --------------------------------------------------------------------------------------------

    def _process(self, frame: Frame, t_ns: int) -> Estimate:
        stages: dict[str, float] = {}
        try:
            if self.state is None:
                return self._try_to_start(frame, t_ns, stages)
            return self._follow(frame, t_ns, stages)
        except np.linalg.LinAlgError as error:  # a covariance that rounding has spoiled must not end the run
            self._lose(t_ns)
            return Estimate(t_ns, Health.LOST, (f"numerical failure ({error})",), None, 0, 0, stages)

    def _lose(self, t_ns: int) -> None:
        """Give the state up; what it knew of its sensors a while ago, and its last pose, remain."""
        self._turn_last_pose(t_ns)
        self._begin_anew()

    def _turn_last_pose(self, t_ns: int) -> None:
        if self._last_pose is not None:
            cells = self._buffer.cells(self._last_pose.t_ns, t_ns)
            learned = self._memory.learned
            b_g = np.zeros(3) if learned is None else learned.mean[:3]
            self._last_pose = self._last_pose.turned(t_ns, cells, b_g, self.calibration.imu)

    def _follow(self, frame: Frame, t_ns: int, stages: dict[str, float]) -> Estimate:
        assert self.state is not None
        assert self._t_ns is not None
        early = t_ns <= self._t_ns  # the time offset was corrected by more than a frame's period
        t_ns = max(t_ns, self._t_ns + 1)
        with stage(stages, "propagate"):
            cells = self._buffer.cells(self._t_ns, t_ns)
            gap_s = float(cells.bridged.sum())
            if gap_s > self.config.health.lost_imu_gap_s:
                self._frontend.observe(frame, None, stages)
                self._lose(t_ns)
                return Estimate(t_ns, Health.LOST, (f"IMU gap of {gap_s:.2f} s cannot be bridged",), stages=stages)
            R_B1B0 = self._propagate(self.state, cells, t_ns)
        observations = self._observations = self._frontend.observe(frame, R_B1B0, stages)
        with stage(stages, "update"):
            outcome, still = VisualOutcome(), False
            if not early:
                outcome, still = self._correct(self.state, frame.t_ns, t_ns, observations)
        with stage(stages, "prior"):
            notes = self._prior.update(self.state, t_ns)
        if gap_s > self.config.health.max_imu_gap_s:
            notes = (f"IMU gap of {gap_s:.3f} s", *notes)
        verdict = self._health.judge(self.state, t_ns, observations, outcome, still)
        if verdict.health is not Health.LOST and self._beaten(self.state, t_ns, observations):
            verdict = Verdict(Health.LOST, ("vision contradicts the state, and agrees with another", *verdict.reasons))
        keep_s = max(self.config.standstill.window_s, WINDOW_S) if self._rival is None else self._start_horizon_s
        self._buffer.drop_before(t_ns - round(1e9 * keep_s))
        reasons = notes + verdict.reasons
        if verdict.health is Health.LOST:
            self._lose(t_ns)
            return Estimate(t_ns, Health.LOST, reasons, None, len(observations), 0, stages)
        estimate = self.state.snapshot()
        if verdict.health is Health.TRACKING and outcome.used > outcome.rejected:
            self._memory.note(self.state, t_ns)
        self._last_pose = LastPose.of(estimate, t_ns)
        return Estimate(t_ns, verdict.health, reasons, estimate, len(observations), outcome.used, stages)

    def _beaten(self, state: FilterState, t_ns: int, observations: Observations) -> bool:
        """While vision contradicts the state, another is looked for; says whether one was found that differs.

        Then it is what the filter starts from next. One that differs, but is not known well enough to start from, is
        reason to go on looking. What moves through the view makes no such state: together with the IMU it fits nothing.
        """
        if not self._health.contradicted:
            self._rival = None
            return False
        if self._rival is None:
            self._rival = self._new_starter()
        bias = self._prior.starting_bias(self.config.start, t_ns, self._memory.learned)
        start = self._rival.attempt(t_ns, observations, self._buffer, bias)
        found = start.state or start.rough
        if found is None:
            return False
        differs = disagreement(state.snapshot(), found) > chi_square_quantile(_SAME_STATE, 5.0)
        if differs and start.state is not None:
            self._told_start = TimedState(t_ns, start.state)
            return True
        if differs:
            self._health.contradict(t_ns)
        elif start.state is not None:
            self._health.confirm()
            self._rival = None
        return False

    def _propagate(self, state: FilterState, cells: Cells, t_ns: int) -> Rotations:
        """Move to the end of the cells; returns the rotation of the end from the start."""
        R_before = state.R_WB
        state.propagate(integrate(cells, state.b_g, state.b_a, self._imu_noise(t_ns)))
        if len(cells.gyro):
            self._omega_B = cells.gyro[-1] - state.b_g
        self._t_ns = t_ns
        return np.asarray(state.R_WB.T @ R_before)

    def _imu_noise(self, t_ns: int) -> ImuNoise:
        """The noise of the samples before `t_ns`."""
        samples = self._buffer.samples(t_ns - round(1e9 * WINDOW_S), t_ns)
        return noise_under_vibration(self.calibration.imu, *samples)

    def _correct(
        self, state: FilterState, frame_ns: int, t_ns: int, observations: Observations
    ) -> tuple[VisualOutcome, bool]:
        """Standstill or visual update; says whether the body stands still."""
        if len(observations.blind) == len(self._rig):  # features may go on in the next image
            return VisualOutcome(), False
        c = self.config.standstill
        if c.enabled and len(state.clones) and imu_is_quiet(self._buffer, t_ns, c):
            disparity = self._window.disparity(observations)
            if disparity is not None and disparity < c.max_disparity and standstill_update(state, c):
                self._window.hold(observations)
                return VisualOutcome(), True
        return self._window.advance(state, frame_ns, self._omega_B, observations), False

    # -- start ------------------------------------------------------------------------------------------------

    def _try_to_start(self, frame: Frame, t_ns: int, stages: dict[str, float]) -> Estimate:
        observations = self._observations = self._frontend.observe(frame, None, stages)
        self._turn_last_pose(t_ns)
        with stage(stages, "start"):
            state, reason = self._find_start(t_ns, observations)
        health = Health.INITIALISING if self._last_pose is None else Health.LOST
        if state is None:
            self._buffer.drop_before(t_ns - round(1e9 * self._start_horizon_s))
            return Estimate(t_ns, health, (reason, *observations.faults), None, len(observations), 0, stages)
        if self._last_pose is not None:
            state = continued(state, self._last_pose, self.config.health.max_speed)
        self.state = self._begun(state)
        self.state.estimate_calibration(*self._known_calibration())
        if self._start_bias is not None:
            self._prior.begin(self.state, self._start_bias)
        self._t_ns = t_ns
        self._health.started(t_ns)
        estimate = self.state.snapshot()
        self._last_pose = LastPose.of(estimate, t_ns)
        return Estimate(t_ns, Health.TRACKING, ("started",), estimate, len(observations), 0, stages)

    @property
    def _start_horizon_s(self) -> float:
        """How long samples are kept for a start."""
        return 2.0 * max(self.config.start.moving_s, self.config.start.static_s)

    def _known_calibration(self) -> tuple[Estimated, Floats]:
        """What of the calibration is estimated, and its covariance beforehand, or as learned."""
        config, learned = self.config.calibration, self._memory.learned
        estimated = Estimated.of(config)
        if learned is None:
            return estimated, np.diag(estimated.sigmas(config, len(self._rig)) ** 2)
        return estimated, learned.doubted_calibration(estimated, config)

    def _begun(self, state: State) -> FilterState:
        return FilterState(state, self._known_rig, self._known_offset_s, fej=self.config.vision.fej)

    def _find_start(self, t_ns: int, observations: Observations) -> tuple[State | None, str]:
        self._start_bias = self._prior.starting_bias(self.config.start, t_ns, self._memory.learned)
        told = self._told_start
        if told is not None:
            if told.t_ns > t_ns or (self._buffer.oldest_ns or 0) > told.t_ns:
                return None, "before the time of the given start"
            self._told_start = None
            s = self._begun(told.state)
            cells = self._buffer.cells(told.t_ns, t_ns)
            s.propagate(integrate(cells, s.b_g, s.b_a, self._imu_noise(t_ns)))
            return s.snapshot(), ""
        start = self._starter.attempt(t_ns, observations, self._buffer, self._start_bias)
        return start.state, start.reason


def make(
    calibration: Calibration,
    prior: BiasPriorSource,
    overrides: Mapping[str, Any],
    start: TimedState | None = None,
) -> Filter:
    """Entry point `navcore.odometry: msckf`: a filter whose settings are `overrides` of the defaults by dotted name."""
    return Filter(calibration, FilterConfig().with_overrides(overrides), prior, start)

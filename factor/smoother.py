"""The smoother as its users see it: IMU samples and frames in, causal estimates out."""

from collections.abc import Callable, Mapping
from importlib.metadata import entry_points
from typing import Any, Protocol

import numpy as np

from factor.bias_prior import PriorError
from factor.config import SmootherConfig
from factor.window import Window
from navcore.arrays import Stamps
from navcore.calibration import Calibration
from navcore.clock import stage
from navcore.errors import ConfigError
from navcore.frontend import Frontend, Observations
from navcore.imu import ImuSamples
from navcore.inbox import Inbox
from navcore.last_pose import LastPose, continued
from navcore.odometry import Estimate, Following, Health, State, TimedState
from navcore.prior import BiasPriorSource, Paced, PriorState, load_prior
from navcore.sequence import Frame, Tracks
from navcore.stillness import image_motion, imu_is_quiet
from navcore.vibration import WINDOW_S, noise_under_vibration

GROUP, STARTER = "navcore.odometry", "msckf"
"""The estimator whose first state it begins with."""
_VELOCITY, _BIASES = slice(6, 9), slice(9, 15)


class Starter(Following, Protocol):
    """An estimator that finds the first state, with what it knows of its bias prior by then."""

    @property
    def prior(self) -> PriorState:
        """What it knows of its bias prior."""
        ...


StarterFactory = Callable[[Calibration, BiasPriorSource, Mapping[str, Any], TimedState | None], Starter]


class Smoother:
    """Fixed-lag smoothing over keyframes. Implements `navcore.odometry.Odometry`.

    It begins with the first state of another estimator, which is done then: at the beginning and after a loss.

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
        config: SmootherConfig | None = None,
        prior: BiasPriorSource | None = None,
        start: TimedState | None = None,
    ) -> None:
        self.config = config or SmootherConfig()
        self.calibration = calibration
        if not 1 <= self.config.cameras <= len(calibration.cameras):
            raise ConfigError(f"{self.config.cameras} cameras asked for, the rig has {len(calibration.cameras)}")
        self._mounts = calibration.cameras[: self.config.cameras]
        health = self.config.health
        self._inbox = Inbox(calibration.imu.rate_hz, health.max_ahead_s, health.max_imu_gap_s)
        self._offset_ns = round(self._mounts[0].dt_cam_imu * 1e9)
        self._frontend = Frontend(self._mounts, self.config.tracker)
        self._observations: Observations | None = None
        self._prior = Paced(prior or load_prior("none"), thinned=self.config.prior.mode == "modelled")
        self._new_starter = _starter()
        self._window: Window | None = None
        self._last: LastPose | None = None
        self._last_b_g = np.zeros(3)
        self._begin_anew(start)

    def _begin_anew(self, start: TimedState | None = None) -> None:
        self._window = None
        self._t_ns: int | None = None
        self._vision_ns = 0
        self._still_since: Observations | None = None
        prior = self.config.prior
        overrides = {"cameras": self.config.cameras, "prior.mode": prior.mode, "prior.weight": prior.weight}
        self._starter = self._new_starter(self.calibration, self._prior.source, overrides, start)
        for samples in self._prior.waiting():
            self._starter.add_imu(samples)

    # -- what it knows, to look at ---------------------------------------------------------------------------------

    @property
    def tracks(self) -> Mapping[int, Tracks]:
        """What each camera followed into the newest frame that was answered, by camera index."""
        return {} if self._observations is None else self._observations.tracks()

    # -- input -----------------------------------------------------------------------------------------------------

    def add_imu(self, samples: ImuSamples) -> list[Estimate]:
        """Take samples that follow all earlier ones in time; returns the estimates that they complete.

        Raises:
            InputError: they do not follow; the smoother is as it was.
        """
        self._inbox.add_imu(samples)
        self._prior.add_imu(samples)
        if self._window is None:
            self._starter.add_imu(samples)
        return self._answer(final=False)

    def add_frame(self, frame: Frame) -> list[Estimate]:
        """Take the next frame; its estimate comes when the IMU covers it.

        Raises:
            InputError: the frame cannot follow, as `navcore.inbox.Inbox` says; the smoother is as it was.
        """
        self._inbox.add_frame(frame)
        return self._answer(final=False)

    def finish(self) -> list[Estimate]:
        """No more input comes: estimates for the frames that were still waiting for the IMU."""
        return self._answer(final=True)

    def _answer(self, *, final: bool) -> list[Estimate]:
        estimates = []
        while (due := self._inbox.next(self._offset_ns, final=final)) is not None:
            if not due.covered:
                estimates.append(Estimate(due.t_ns, Health.LOST, ("no IMU up to this frame",)))
            else:
                estimates.append(self._process(due.frame, due.t_ns))
        return estimates

    def _process(self, frame: Frame, t_ns: int) -> Estimate:
        stages: dict[str, float] = {}
        try:
            if self._window is None:
                return self._start(frame, t_ns, stages)
            return self._follow(self._window, frame, t_ns, stages)
        except (RuntimeError, np.linalg.LinAlgError) as error:  # so GTSAM says that something is not determined
            return self._lose(t_ns, f"numerical failure ({str(error).strip().splitlines()[0]})", stages)

    # -- one frame -------------------------------------------------------------------------------------------------

    def _start(self, frame: Frame, t_ns: int, stages: dict[str, float]) -> Estimate:
        """Let the starter have the frame; if it knows where it is, go on from there."""
        observations = self._observations = self._frontend.observe(frame, None, stages)
        if self._last is not None:
            cells = self._inbox.buffer.cells(self._last.t_ns, t_ns)
            self._last = self._last.turned(t_ns, cells, self._last_b_g, self.calibration.imu)
        with stage(stages, "start"):
            (found,) = self._starter.add_frame(frame) or self._starter.finish()
        self._prior.taken(t_ns)  # the starter has handed them to the source
        self._inbox.buffer.drop_before(t_ns - round(1e9 * WINDOW_S))
        state = found.state
        if state is None:
            health = found.health if self._last is None else Health.LOST
            return Estimate(t_ns, health, found.reasons, None, found.tracked, 0, stages)
        if self._last is not None:
            state = continued(state, self._last, self.config.health.max_speed)
        c, known = self.config, self._starter.prior
        self._prior.latest = known.latest or self._prior.latest
        told = _error(known, state), self._prior.latest
        self._window = Window(self._mounts, self.calibration.imu, c.window, c.prior, state, *told, observations)
        self._note(state, t_ns)
        self._vision_ns = t_ns
        return Estimate(t_ns, Health.TRACKING, ("started",), state, len(observations), 0, stages)

    def _follow(self, window: Window, frame: Frame, t_ns: int, stages: dict[str, float]) -> Estimate:
        assert self._t_ns is not None
        c = self.config.health
        cells = self._inbox.buffer.cells(self._t_ns, t_ns)
        gap_s = float(cells.bridged.sum())
        if gap_s > c.lost_imu_gap_s:
            self._observations = self._frontend.observe(frame, None, stages)
            return self._lose(t_ns, f"IMU gap of {gap_s:.2f} s cannot be bridged", stages)
        with stage(stages, "integrate"):
            samples = self._inbox.buffer.samples(t_ns - round(1e9 * WINDOW_S), t_ns)
            R_B1B0 = window.integrate(cells, noise_under_vibration(self.calibration.imu, *samples))
        observations = self._observations = self._frontend.observe(frame, R_B1B0, stages)
        with stage(stages, "prior"):
            said = self._prior.said(t_ns)
        with stage(stages, "solve"):
            still = self._stands_still(observations, t_ns)
            outcome = window.advance(observations, said, t_ns, still=still)
        self._inbox.buffer.drop_before(t_ns - round(1e9 * max(WINDOW_S, self.config.stillness.window_s)))
        state = outcome.state
        lost = self._absurd(state)
        if lost:
            return self._lose(t_ns, lost, stages)
        reasons = list(observations.faults)
        if still:
            reasons.append("standing still")
        if gap_s > c.max_imu_gap_s:
            reasons.insert(0, f"IMU gap of {gap_s:.3f} s")
        if outcome.refused > outcome.used:
            reasons.append(f"{outcome.refused} features refused")
        if still or outcome.used >= c.min_used:
            self._vision_ns = t_ns
        blind_s = (t_ns - self._vision_ns) * 1e-9
        health = Health.TRACKING
        if blind_s > c.blind_s:
            health = Health.INERTIAL_ONLY
            reasons.append(f"no visual correction for {blind_s:.1f} s")
        self._note(state, t_ns)
        return Estimate(t_ns, health, tuple(reasons), state, len(observations), outcome.used, stages)

    def _stands_still(self, observations: Observations, t_ns: int) -> bool:
        """Whether IMU and images say so; the image is compared with the one where it began."""
        c, before = self.config.stillness, self._still_since
        if not (c.enabled and len(observations) and imu_is_quiet(self._inbox.buffer, t_ns, c)):
            self._still_since = None
            return False
        if before is not None:
            _, rows, columns = np.intersect1d(_marks(before), _marks(observations), return_indices=True)
            moved = image_motion(before.uv[rows], observations.uv[columns])
            if moved is not None and moved < c.max_disparity:
                return True
        self._still_since = observations
        return False

    def _note(self, state: State, t_ns: int) -> None:
        self._t_ns = t_ns
        self._last, self._last_b_g = LastPose.of(state, t_ns), state.b_g

    def _absurd(self, state: State) -> str:
        """Why a state is not to be trusted at all, or nothing."""
        c = self.config.health
        if not (np.isfinite(state.covariance).all() and np.isfinite(state.p_WB).all()):
            return "state is not finite"
        variance = np.diagonal(state.covariance)
        if variance.min() < 0.0:
            return "a variance is negative"
        speed = float(np.linalg.norm(state.v_WB))
        if speed > c.max_speed:
            return f"speed {speed:.1f} m/s is past {c.max_speed:.1f}"
        sigma = float(np.sqrt(variance[_VELOCITY].max()))
        return f"velocity is known to {sigma:.1f} m/s only" if sigma > c.max_velocity_sigma else ""

    def _lose(self, t_ns: int, why: str, stages: dict[str, float]) -> Estimate:
        tracked = 0 if self._observations is None else len(self._observations)
        self._prior.feed(t_ns)
        self._begin_anew()
        return Estimate(t_ns, Health.LOST, (why,), None, tracked, 0, stages)


def _marks(observations: Observations) -> Stamps:
    """(N,) a number for each feature in each camera."""
    return observations.keys * 64 + observations.cameras


def _error(known: PriorState, state: State) -> PriorError | None:
    """What a starter knows of the prior's constant error, by what follows the biases and what does not."""
    if known.c is None or known.covariance is None or known.with_biases is None:
        return None
    gain = np.asarray(np.linalg.solve(state.covariance[_BIASES, _BIASES], known.with_biases.T).T, dtype=np.float64)
    rest = known.covariance - gain @ known.with_biases.T
    return PriorError(known.c, gain, 0.5 * (rest + rest.T))


def _starter() -> StarterFactory:
    """The filter, by its name: whoever imports this does not import that."""
    (entry,) = entry_points(group=GROUP, name=STARTER)
    factory: StarterFactory = entry.load()
    return factory


def make(
    calibration: Calibration,
    prior: BiasPriorSource,
    overrides: Mapping[str, Any],
    start: TimedState | None = None,
) -> Smoother:
    """Entry point `navcore.odometry: factor`: settings are `overrides` of the defaults by dotted name."""
    return Smoother(calibration, SmootherConfig().with_overrides(overrides), prior, start)

"""What every estimator offers and says: `Odometry`, `Estimate`, `Health`, and the `Run` they add up to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps, Vectors
from navcore.imu import ImuSamples
from navcore.sequence import Frame, Sequence, Tracks
from navcore.trajectory import Trajectory

BLOCKS = ("dtheta", "dp", "dv", "db_g", "db_a")
"""Order of the 15 error states in `Estimate.covariance`."""

SKIPPED = "skipped"
"""First word of the reason for an image that was left out, as in `skipped: data/1.png: corrupt image`."""


class Health(Enum):
    """What an estimate is worth."""

    INITIALISING = "INITIALISING"  # no pose yet
    TRACKING = "TRACKING"  # vision corrects the state
    INERTIAL_ONLY = "INERTIAL_ONLY"  # dead reckoning: vision says nothing, or nothing that fits
    LOST = "LOST"  # the state is not to be trusted; a new start is under way


@dataclass(frozen=True)
class State:
    """Navigation state and covariance at one time.

    Attributes:
        R_WB: (3, 3).
        p_WB: (3,) m.
        v_WB: (3,) m/s.
        b_g, b_a: (3,) rad/s and m/s^2.
        covariance: (15, 15) of the error state in the order of `BLOCKS`.
    """

    R_WB: Rotations
    p_WB: Vectors
    v_WB: Vectors
    b_g: Vectors
    b_a: Vectors
    covariance: Floats


@dataclass(frozen=True)
class TimedState:
    """A state that an estimator is told to start from, at IMU time `t_ns`."""

    t_ns: int
    state: State


@dataclass(frozen=True)
class Estimate:
    """What an estimator knew at one frame, when it had processed it; never rewritten.

    Attributes:
        t_ns: IMU time.
        health, reasons: how good it is, and why it is not better: a few words, or words, a colon and details.
        state: None before the start and while lost.
        tracked: features followed into this frame.
        used: features that corrected the state at this frame.
        stages: CPU seconds by stage.
    """

    t_ns: int
    health: Health
    reasons: tuple[str, ...] = ()
    state: State | None = None
    tracked: int = 0
    used: int = 0
    stages: Mapping[str, float] = field(default_factory=dict)


class Odometry(Protocol):
    """An estimator fed with samples and frames as they come.

    An estimate becomes available once the IMU covers its frame; both calls return those that did.
    """

    def add_imu(self, samples: ImuSamples) -> list[Estimate]:
        """Take samples that follow all earlier ones in time."""
        ...

    def add_frame(self, frame: Frame) -> list[Estimate]:
        """Take the next frame."""
        ...

    def finish(self) -> list[Estimate]:
        """No more input comes: estimates for the frames that can still be answered."""
        ...


class Following(Odometry, Protocol):
    """An estimator that shows what it follows."""

    @property
    def tracks(self) -> Mapping[int, Tracks]:
        """What each camera followed into the newest frame that was answered."""
        ...


@dataclass(frozen=True)
class Run:
    """All estimates of one run, as arrays over its frames.

    Attributes:
        estimates: one per frame, without the full covariances.
        covariances: (M, 5, 3, 3) diagonal blocks in the order of `BLOCKS`, for the frames that have a state.
    """

    estimates: tuple[Estimate, ...]
    covariances: Floats
    has_state: Mask

    @property
    def trajectory(self) -> Trajectory:
        """The causal estimates, in IMU time, with velocity and biases."""
        found = [(e.t_ns, e.state) for e in self.estimates if e.state is not None]

        def column(name: str) -> Floats:
            return np.array([getattr(s, name) for _, s in found]).reshape(-1, 3)

        t_ns: Stamps = np.array([t for t, _ in found], dtype=np.int64)
        q_WB = so3.to_quaternion(np.array([s.R_WB for _, s in found]).reshape(-1, 3, 3))
        return Trajectory(t_ns, q_WB, column("p_WB"), column("v_WB"), column("b_g"), column("b_a"))

    @property
    def sigmas(self) -> Floats:
        """(M, 5, 3) standard deviations in the order of `BLOCKS`."""
        return np.sqrt(np.diagonal(self.covariances, axis1=2, axis2=3))

    @property
    def completeness(self) -> float:
        """Share of frames that have a state."""
        return float(self.has_state.mean()) if len(self.has_state) else 0.0


class RunRecorder:
    """Collects estimates into a `Run`, keeping of each covariance only its diagonal blocks."""

    def __init__(self) -> None:
        self._estimates: list[Estimate] = []
        self._covariances: list[Floats] = []

    def add(self, estimates: list[Estimate]) -> None:
        """Append estimates in time order."""
        for estimate in estimates:
            state = estimate.state
            if state is not None:
                blocks = np.array([state.covariance[k : k + 3, k : k + 3] for k in range(0, 15, 3)])
                self._covariances.append(blocks)
                slim = State(state.R_WB, state.p_WB, state.v_WB, state.b_g, state.b_a, np.zeros((0, 0)))
                estimate = Estimate(
                    estimate.t_ns,
                    estimate.health,
                    estimate.reasons,
                    slim,
                    estimate.tracked,
                    estimate.used,
                    estimate.stages,
                )
            self._estimates.append(estimate)

    def result(self) -> Run:
        """What was collected."""
        has_state = np.array([e.state is not None for e in self._estimates], dtype=bool)
        return Run(tuple(self._estimates), np.array(self._covariances).reshape(-1, 5, 3, 3), has_state)


def run(odometry: Odometry, sequence: Sequence, progress: Callable[[int], None] | None = None) -> Run:
    """Feed a recording to an estimator in the order of time; `progress` gets the number of frames done."""
    recorder = RunRecorder()
    frames = 0
    for event in sequence.events():
        if isinstance(event, Frame):
            recorder.add(odometry.add_frame(event))
            frames += 1
            if progress is not None:
                progress(frames)
        else:
            recorder.add(odometry.add_imu(event))
    recorder.add(odometry.finish())
    return recorder.result()

"""A recording and an estimator that need no simulator: truth plus errors that are known."""

import os
import signal
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np

from eval.cells import Cost
from navcore import so3
from navcore.calibration import Calibration
from navcore.imu import ImuNoise, ImuSamples
from navcore.odometry import Estimate, Health, State
from navcore.prior import BiasPriorSource
from navcore.sequence import Frame, Sequence
from tests.eval.paths import flight

NOISE = ImuNoise(1e-4, 1e-5, 2e-3, 3e-3)
SIGMA = np.repeat([0.01, 0.1, 0.05, 1e-3, 0.02], 3)


@dataclass(frozen=True)
class FakeFlight:
    """A recording whose truth the fake estimator is told through the IMU's place; see `FakeOdometry`."""

    seed: int
    seconds: float = 20.0

    @property
    def name(self) -> str:
        return f"fake {self.seed}"

    @property
    def cost(self) -> Cost:
        return Cost(0.0, 0.1, 0.2)

    def load(self, workspace: Path) -> Sequence:
        truth = flight(np.random.default_rng(self.seed), self.seconds)
        imu = ImuSamples(truth.t_ns, truth.p_WB, so3.log(truth.R_WB))  # the fake reads its truth from here
        frames = [Frame(int(t)) for t in truth.t_ns[5:-5]]
        return Sequence(f"fake{self.seed}", Calibration(NOISE), imu, frames, truth)


class FakeOdometry:
    """Answers each frame with the truth plus noise of a known spread; a bias prior is asked, and not believed.

    Overrides: `scale` of the errors; `draw`, the seed of the noise; `fail`, a message to raise;
    `blind_after`, the frame from which there is no state; `kill_once`, a file: the first time that it is
    missing the whole process ends hard; `diary`, a file that gets a line for every run that begins; `sleep_s`.
    """

    def __init__(self, overrides: Mapping[str, Any], prior: BiasPriorSource | None = None) -> None:
        self._prior = prior
        self._options = {"scale": 1.0, "draw": 0, "fail": "", "blind_after": 10**9, "kill_once": ""}
        self._options |= {"diary": "", "sleep_s": 0.0} | overrides
        self._rng = np.random.default_rng(self._options["draw"])
        self._seen = 0
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        if self._options["diary"]:
            with Path(self._options["diary"]).open("a") as diary:
                diary.write(f"{self._options['draw']} {os.getpid()}\n")
        sleep(self._options["sleep_s"])

    def add_imu(self, samples: ImuSamples) -> list[Estimate]:
        self._last = samples.gyro[-1], samples.accel[-1]
        return []

    def add_frame(self, frame: Frame) -> list[Estimate]:
        self._seen += 1
        if self._prior is not None:
            self._prior.poll(frame.t_ns)
        if self._options["fail"] and self._seen > 10:
            raise RuntimeError(self._options["fail"])
        flag = self._options["kill_once"]
        if flag and not Path(flag).exists():
            Path(flag).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if self._seen > self._options["blind_after"] or self._last is None:
            return [Estimate(frame.t_ns, Health.LOST, ("blind",))]
        e = self._options["scale"] * SIGMA * self._rng.standard_normal(15)
        p, phi = self._last
        R = so3.exp(phi) @ so3.exp(-e[:3])
        b_g, b_a = np.array([0.01, -0.02, 0.03]) - e[9:12], np.array([0.1, 0.2, -0.3]) - e[12:]
        state = State(R, p - e[3:6], -e[6:9], b_g, b_a, np.diag(SIGMA**2))
        return [Estimate(frame.t_ns, Health.TRACKING, (), state, 100, 40, {"all": 1e-3})]

    def finish(self) -> list[Estimate]:
        return []


def make(
    calibration: Calibration, prior: BiasPriorSource, overrides: Mapping[str, Any], seed_state: Any = None
) -> FakeOdometry:
    return FakeOdometry(overrides)


def make_asking(
    calibration: Calibration, prior: BiasPriorSource, overrides: Mapping[str, Any], seed_state: Any = None
) -> FakeOdometry:
    """The same, and it asks the prior at every frame."""
    return FakeOdometry(overrides, prior)

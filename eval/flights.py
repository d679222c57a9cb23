"""Simulated recordings of a study: a flight with tracks, made when it is needed, or with images, rendered once."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from time import sleep
from typing import Any

from eval.cells import Cost, described
from eval.errors import StudyError
from eval.versions import code_digest
from navcore.readers import open_sequence
from navcore.sequence import Sequence
from sim.degrade import Schedule
from sim.errors import BusyError, ConfigError
from sim.motion import Motion
from sim.output import write_recording
from sim.platforms import simulate_motion
from sim.points import IMU_GRADE, simulate_points
from sim.record import filmed

FRAME_HZ = 20.0
IMAGE_BYTES = 250_000
"""Of a rendered image on disk, at most about."""
Rendering = Callable[[int, int], None]
"""Called with the number of images rendered and of all."""

# CPU seconds on the machine of docs/study.md.
_MOTION_S = 0.018  # a second of flight
_POINTS_S = 0.006  # the same, its tracks
_POINTS_RUN_S = 0.0035  # a frame
_RENDER_S, _BLUR_S = 0.085, 0.2  # a frame
IMAGE_RUN_S = 0.010  # a frame, with its decoding

_BUSY_S = 5.0  # between two looks at a flight that another process renders
_RENDERERS = ("numpy", "scipy", "opencv-python-headless", "mujoco")


@dataclass(frozen=True)
class Flight:
    """Which motion of which body in which world, and what feels it; as `sim.record.filmed` takes them."""

    platform: str
    seconds: float
    seed: int
    difficulty: str = "medium"
    moving_start: bool = False
    imu: str = IMU_GRADE
    scene: str = "room"

    @property
    def frames(self) -> float:
        """About how many."""
        return self.seconds * FRAME_HZ

    def motion(self) -> Motion:
        """The motion; the last few are kept, as all degradations of a flight share it."""
        return _motion(self.platform, self.seconds, self.seed, self.moving_start, self.difficulty)


@lru_cache(maxsize=4)
def _motion(platform: str, seconds: float, seed: int, moving_start: bool, difficulty: str) -> Motion:
    return simulate_motion(platform, seconds, seed, moving_start, difficulty)


@dataclass(frozen=True)
class PointsFlight:
    """A simulated recording with tracks instead of images, made when it is needed.

    Attributes:
        flight: which.
        degrade: what happens to vision, as `Schedule.parse` reads it.
        noise_seed: another draw of IMU and vision over the same motion and world.
        pixel_noise: px, sd per axis.
        max_features: in an image.
    """

    flight: Flight
    degrade: str = ""
    noise_seed: int | None = None
    pixel_noise: float = 1.0
    max_features: int = 150

    @property
    def name(self) -> str:
        """The flight's seed."""
        return f"seed {self.flight.seed}"

    @property
    def cost(self) -> Cost:
        """The motion is simulated once in a few times."""
        flight = self.flight
        return Cost(0.0, (_MOTION_S / 2.0 + _POINTS_S) * flight.seconds, _POINTS_RUN_S * flight.frames)

    def load(self, workspace: Path) -> Sequence:
        """Simulate it."""
        flight = self.flight
        return simulate_points(
            flight.platform,
            flight.seconds,
            flight.seed,
            pixel_noise=self.pixel_noise,
            max_features=self.max_features,
            moving_start=flight.moving_start,
            difficulty=flight.difficulty,
            imu=flight.imu,
            scene=flight.scene,
            degrade=self.degrade,
            motion=flight.motion(),
            noise_seed=self.noise_seed,
        )


@dataclass(frozen=True)
class RenderedFlight:
    """A simulated recording with images, kept in the study's folder.

    Attributes:
        flight: which.
        degrade: what is done inside the camera; the rest is `Degraded`'s.
        simulator: hash of the code and names of the libraries that render it: others give other images.
    """

    flight: Flight
    degrade: str
    simulator: str

    @staticmethod
    def of(flight: Flight, degrade: str = "") -> "RenderedFlight":
        """A flight in the simulator as it is now."""
        return RenderedFlight(flight, degrade, _simulator())

    @property
    def name(self) -> str:
        """The flight's seed."""
        return f"seed {self.flight.seed}"

    @property
    def cost(self) -> Cost:
        """Rendering takes most."""
        frames = self.flight.frames
        blurred = sum(d.end_s - d.start_s for d in Schedule.parse(self.degrade).degradations) * FRAME_HZ
        return Cost(_RENDER_S * frames + (_BLUR_S - _RENDER_S) * blurred, 0.2, IMAGE_RUN_S * frames)

    def folder(self, workspace: Path) -> Path:
        """Where it is kept, by what it is."""
        return workspace / "recordings" / f"{self.flight.platform}-seed{self.flight.seed}-{_digest(self)}"

    def make(self, workspace: Path, progress: Rendering | None = None) -> None:
        """Render it, unless it is there; the folder appears whole or not at all, whoever else makes it meanwhile.

        What was cut goes on after the images that are there.
        """
        folder = self.folder(workspace)
        while not folder.is_dir():
            try:
                self._render(folder, progress)
            except BusyError:
                sleep(_BUSY_S)
            except (ConfigError, OSError):
                if not folder.is_dir():  # otherwise another one was first
                    raise

    def _render(self, folder: Path, progress: Rendering | None) -> None:
        flight = self.flight
        with filmed(
            flight.platform,
            flight.seconds,
            flight.seed,
            degrade=self.degrade,
            moving_start=flight.moving_start,
            difficulty=flight.difficulty,
            imu=flight.imu,
            scene=flight.scene,
        ) as sequence:
            write_recording(sequence, folder, origin=described(self), progress=progress)

    def load(self, workspace: Path) -> Sequence:
        """Read it.

        Raises:
            StudyError: it was not made.
        """
        folder = self.folder(workspace)
        if not folder.is_dir():
            raise StudyError(f"{folder}: the recording was not made")
        return open_sequence(folder)


@lru_cache(maxsize=1)
def _simulator() -> str:
    """What this process renders with."""
    return "-".join((code_digest(("navcore", "sim")), *(version(name) for name in _RENDERERS)))


def _digest(source: Any) -> str:
    return hashlib.sha256(repr(described(source)).encode()).hexdigest()[:8]

"""Where the recordings of a study come from: simulated points, simulated images, or a folder."""

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from eval.cells import code_digest
from eval.errors import StudyError
from navcore.readers import open_sequence
from navcore.sequence import Sequence
from sim.motion import Motion
from sim.platforms import simulate_motion
from sim.points import simulate_points
from sim.record import record


@dataclass(frozen=True)
class PointsFlight:
    """A simulated recording with tracks instead of images, made when it is needed.

    Attributes:
        platform, seconds, seed: which motion in which world.
        degrade: what happens to vision, as `sim.schedule` reads it.
        noise_seed: another draw of IMU and vision over the same motion and world.
        pixel_noise: px, sd per axis.
    """

    platform: str
    seconds: float
    seed: int
    degrade: str = ""
    noise_seed: int | None = None
    pixel_noise: float = 1.0

    def load(self, workspace: Path) -> Sequence:
        """Simulate it; the motion of the last seed is kept, as its degradations share it."""
        return simulate_points(
            self.platform,
            self.seconds,
            self.seed,
            pixel_noise=self.pixel_noise,
            degrade=self.degrade,
            motion=_motion(self.platform, self.seconds, self.seed),
            noise_seed=self.noise_seed,
        )


@lru_cache(maxsize=1)
def _motion(platform: str, seconds: float, seed: int) -> Motion:
    return simulate_motion(platform, seconds, seed)


@dataclass(frozen=True)
class RenderedFlight:
    """A simulated recording with images, kept in the study's folder.

    Attributes:
        platform, seconds, seed, degrade: as in `PointsFlight`.
        simulator: hash of the code that renders it; images of another simulator are other images.
    """

    platform: str
    seconds: float
    seed: int
    degrade: str
    simulator: str

    @staticmethod
    def of(platform: str, seconds: float, seed: int, degrade: str = "") -> "RenderedFlight":
        """A flight in the simulator as it is now."""
        return RenderedFlight(platform, seconds, seed, degrade, code_digest(("navcore", "sim")))

    def folder(self, workspace: Path) -> Path:
        """Where it is kept, by what it is."""
        what = hashlib.sha256(repr(self).encode()).hexdigest()[:8]
        return workspace / "recordings" / f"{self.platform}-seed{self.seed}-{what}"

    def make(self, workspace: Path) -> None:
        """Render it, unless it is there; the folder appears whole or not at all."""
        folder = self.folder(workspace)
        if not folder.is_dir():
            record(self.platform, self.seconds, self.seed, folder, degrade=self.degrade)

    def load(self, workspace: Path) -> Sequence:
        """Read it.

        Raises:
            StudyError: it was not made.
        """
        folder = self.folder(workspace)
        if not folder.is_dir():
            raise StudyError(f"{folder}: the recording was not made")
        return open_sequence(folder)


@dataclass(frozen=True)
class Recording:
    """A recording in a folder, as `navcore.readers` knows it; its name in the study is its path."""

    path: str

    def load(self, workspace: Path) -> Sequence:
        """Read it."""
        return open_sequence(Path(self.path))

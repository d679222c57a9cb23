"""`python -m sim fleet`: many recordings to learn from."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from sim.commands.bar import progress_bar
from sim.commands.choices import DifficultyName, GradeName, PlatformName
from sim.fleet import Fleet as Recordings
from sim.fleet import Start


@dataclass(frozen=True)
class Fleet:
    """Simulate many recordings of IMU and truth, as folders PLATFORM-SEED. Interrupted, the same command goes on.

    Each list is gone through again and again: recording k takes entry k of each.
    """

    out: Path  # folder of the recordings; what is whole in it is kept
    platform: PlatformName = "quadrotor"  # which body moves
    count: int = 300  # how many recordings
    first_seed: int = 100001  # of the first; studies use seeds up to 1040
    seconds: float = 90.0  # length of each
    imu: tuple[GradeName, ...] = ("consumer", "adis16448", "n100", "cheap")  # grades, in turn
    difficulty: tuple[DifficultyName, ...] = ("easy", "medium", "difficult")  # how the body moves, in turn
    start: tuple[Start, ...] = (*("still",) * 2, *("moving",) * 6)  # how each begins, in turn
    flights: Path | None = None  # folder in which motions are kept: physics runs once for all grades
    workers: int = 1  # processes at the same time; the bytes are the same

    def run(self, console: Console) -> None:
        """Record them all, with a progress bar."""
        fleet = Recordings(
            self.platform, self.count, self.first_seed, self.seconds, self.imu, self.difficulty, self.start
        )
        with progress_bar(console, "recording", "recordings") as progress:
            fleet.write(self.out, workers=self.workers, flights=self.flights, progress=progress)
        console.print(f"{self.count} recordings are in {self.out}")

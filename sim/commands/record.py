"""`python -m sim record`: simulate a platform."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from sim.commands.bar import progress_bar
from sim.commands.choices import DifficultyName, GradeName, PlatformName, SceneName
from sim.output import Format
from sim.points import IMU_GRADE
from sim.record import Mode, record


@dataclass(frozen=True)
class Record:
    """Simulate a platform and write what its sensors say. Interrupted, the same command goes on."""

    out: Path  # folder to make; new or empty
    platform: PlatformName = "quadrotor"  # which body moves
    seconds: float = 60.0  # length of the recording
    seed: int = 1  # fixes everything that is random
    noise_seed: int | None = None  # draw IMU, biases and sensor noise anew; motion, world and degradations stay
    flights: Path | None = (
        None  # folder in which motions are kept: physics runs once for all noise seeds, grades, scenes
    )
    degrade: str = ""  # KIND[:SEVERITY]@START-END,... such as low_light:3@20-35, or a benchmark's cell: v1/night
    mode: Mode = "images"  # rendered images, tracks of landmarks, or IMU and truth alone
    start_in_motion: bool = False  # begin in full motion instead of standing still
    cameras: int = 1  # 1 or 2
    difficulty: DifficultyName = "medium"  # how the body moves
    imu: GradeName = IMU_GRADE  # its grade
    scene: SceneName = "room"  # what is around
    movers: int = 0  # things that move through the scene on paths of their own
    switch_lamps: bool = False  # the scene's lamps go out and on
    format: Format = "asl"  # EuRoC's layout, or a ROS bag

    def run(self, console: Console) -> None:
        """Record, with a progress bar."""
        with progress_bar(console, "recording") as progress:
            record(
                self.platform,
                self.seconds,
                self.seed,
                self.out,
                degrade=self.degrade,
                mode=self.mode,
                moving_start=self.start_in_motion,
                cameras=self.cameras,
                difficulty=self.difficulty,
                imu=self.imu,
                scene=self.scene,
                movers=self.movers,
                switching=self.switch_lamps,
                noise_seed=self.noise_seed,
                flights=self.flights,
                format=self.format,
                progress=progress,
            )
        console.print(f"recorded {self.out}")

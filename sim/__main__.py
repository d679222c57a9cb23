"""`python -m sim record|strip|check-gl`: recordings, a picture of degradations, the OpenGL they need."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from navcore.errors import NavcoreError
from sim import gl
from sim.errors import SimError
from sim.record import record
from sim.strip import strip


@dataclass(frozen=True)
class Record:
    """Simulate a platform and write what its sensors say, in EuRoC's layout."""

    out: Path  # folder to make; new or empty
    platform: str = "quadrotor"  # which body moves
    seconds: float = 60.0  # length of the recording
    seed: int = 1  # fixes everything that is random
    degrade: str = ""  # KIND[:SEVERITY]@START-END,... such as low_light:3@20-35,blackout@40-45
    mode: Literal["images", "points"] = "images"  # rendered images, or tracks of landmarks
    start_in_motion: bool = False  # begin in full motion instead of standing still
    cameras: int = 1  # 1 or 2

    def run(self, console: Console) -> None:
        """Record, with a progress bar."""
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console) as bar:
            task = bar.add_task("simulating", total=None)
            record(
                self.platform,
                self.seconds,
                self.seed,
                self.out,
                degrade=self.degrade,
                mode=self.mode,
                moving_start=self.start_in_motion,
                cameras=self.cameras,
                progress=lambda done, total: bar.update(task, description="rendering", completed=done, total=total),
            )
        console.print(f"recorded {self.out}")


@dataclass(frozen=True)
class Strip:
    """Render one view of a flight under every degradation, as one picture."""

    out: Path  # PNG to write
    seed: int = 1  # of the flight and the room

    def run(self, console: Console) -> None:
        """Render and write."""
        strip(self.out, self.seed)
        console.print(f"wrote {self.out}")


@dataclass(frozen=True)
class CheckGl:
    """Say whether images can be rendered here; exit with 1 if they cannot."""

    install: bool = False  # install Mesa's software renderer if it is missing (as root, by apt-get)

    def run(self, console: Console) -> None:
        """Check, and install if that is asked for and needed."""
        if not gl.works():
            if not self.install:
                raise SimError(f"no OpenGL here that renders without a screen; as root type: {gl.INSTALL}")
            gl.install()
        console.print("OpenGL renders")


def main() -> None:
    """Parse the command line and run it."""
    command = tyro.cli(
        Annotated[Record, tyro.conf.subcommand("record")]
        | Annotated[Strip, tyro.conf.subcommand("strip")]
        | Annotated[CheckGl, tyro.conf.subcommand("check-gl")],
        prog="python -m sim",
    )
    console = Console(stderr=True, soft_wrap=True)
    try:
        command.run(console)
    except (SimError, NavcoreError) as error:
        console.print(f"error: {error}", style="red", markup=False, highlight=False)
        sys.exit(1)


if __name__ == "__main__":
    main()

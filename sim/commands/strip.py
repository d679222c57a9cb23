"""`python -m sim strip`: a picture of degradations."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from sim.strip import strip


@dataclass(frozen=True)
class Strip:
    """Show one view under every degradation and severity, as one picture."""

    out: Path  # .png or .jpg to write
    seed: int = 1  # of the flight, and of what is random in the degradations
    recording: Path | None = None  # show this recording instead of a rendered flight

    def run(self, console: Console) -> None:
        """Make it and write it."""
        strip(self.out, self.seed, self.recording)
        console.print(f"wrote {self.out}")

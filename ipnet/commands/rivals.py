"""`python -m ipnet window-mean`, `recursive`, `corrector`: make rivals from recordings whose biases are known."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from ipnet.files import write_text
from ipnet.recordings import open_recordings
from ipnet.rivals.window_mean import calibrate


@dataclass(frozen=True)
class WindowMean:
    """Calibrate `window-mean`: how wrong it is, and the platform's mean force."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]  # recordings, or folders that hold some at any depth
    out: Path  # file to write
    labels: Path | None = None  # for recordings whose truth has no biases
    seconds: float = 5.0  # length of a window
    mounted: bool = False  # the IMU always sits in the platform in the same way

    def run(self, console: Console) -> None:
        """Calibrate and write."""
        found = calibrate(open_recordings(self.paths, self.labels), self.seconds, self.mounted)
        write_text(self.out, json.dumps(found.as_dict(), indent=1) + "\n")
        console.print(f"wrote {self.out}, from {len(found.recordings)} recordings")


@dataclass(frozen=True)
class Recursive:
    """Train `recursive`, an LSTM that takes its own past bias as input."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]  # recordings to learn from
    validate: tuple[Path, ...]  # recordings that choose the best epoch and calibrate
    out: Path  # folder of the weights, with its log
    labels: Path | None = None  # for recordings whose truth has no biases
    epochs: int = 150  # at most
    seed: int = 1  # of weights and windows

    def run(self, console: Console) -> None:
        """Train, calibrate, write."""
        from ipnet.rivals.learning import Lessons, learn_recursive

        kept = self.out / "recordings"
        learn_recursive(Lessons.read(self.paths, self.validate, self.labels, kept, self.epochs, self.seed), self.out)
        console.print(f"wrote {self.out}")


@dataclass(frozen=True)
class Corrector(Recursive):
    """Train `corrector`, a network that corrects samples; its mean correction is its statement of the bias."""

    def run(self, console: Console) -> None:
        """Train, calibrate, write."""
        from ipnet.rivals.learning import Lessons, learn_corrector

        kept = self.out / "recordings"
        learn_corrector(Lessons.read(self.paths, self.validate, self.labels, kept, self.epochs, self.seed), self.out)
        console.print(f"wrote {self.out}")

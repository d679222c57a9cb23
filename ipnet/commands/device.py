"""`python -m ipnet device`: what a few recordings say of one device."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from ipnet.device import learn
from ipnet.recordings import open_recordings


@dataclass(frozen=True)
class Device:
    """Learn mean and spread of one device's biases from recordings; the file is a valid --prior constant:FILE."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]  # recordings, or folders that hold some at any depth
    out: Path  # file to write
    labels: Path | None = None  # for recordings whose truth has no biases: what `label` wrote

    def run(self, console: Console) -> None:
        """Learn and write."""
        recordings = open_recordings(self.paths, self.labels)
        learn([r.label for r in recordings]).write(self.out)
        console.print(f"wrote {self.out}, from {', '.join(r.name for r in recordings)}")

"""`python -m ipnet window-mean` and others: find the numbers of a rival on recordings whose biases are known."""

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

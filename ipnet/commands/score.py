"""`python -m ipnet score`: how good bias prior sources are on recordings whose biases are known."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from ipnet.errors import ConfigError
from ipnet.files import write_text
from ipnet.fusion import SPREAD
from ipnet.offsets import OFFSET
from ipnet.recordings import open_recordings
from ipnet.runs import cut
from ipnet.score_tables import tables
from ipnet.scoring import ScoreConfig, Scores, score


@dataclass(frozen=True)
class Score:
    """Score bias prior sources on recordings: error, offset response, coverage, likelihood."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]  # recordings, or folders that hold some at any depth
    prior: tuple[str, ...]  # sources: NAME or NAME:ARGUMENT, as window-mean:60 constant:device.json
    labels: Path | None = None  # for recordings whose truth has no biases: what `label` wrote
    labels_first: bool = False  # hold against labels also where truth has biases
    device: str = ""  # joined in, as constant:FILE.json
    seconds: float | None = None  # cut recordings into runs of this length
    skip: float = 0.0  # seconds at each recording's beginning that are left out
    frame: str = "imu"  # axes of the errors: imu, thrust (mean specific force), or its direction x,y,z
    offset: tuple[float, float] = OFFSET  # injected offsets [rad/s, m/s^2]; 0 0 for none
    spread: tuple[float, float] = SPREAD  # sd of biases of which nothing is known [rad/s, m/s^2]
    out: Path | None = None  # file to write: .json for all figures, .md for the tables

    def run(self, console: Console) -> None:
        """Score, with a progress bar; tables go to the terminal."""
        if self.out is not None and self.out.suffix not in (".json", ".md"):
            raise ConfigError(f"--out is {self.out}, expected a name that ends in .json or .md")
        spans = cut(open_recordings(self.paths, self.labels, self.labels_first), self.seconds, self.skip)
        config = ScoreConfig(self.prior, self.device, frame=self.frame, offset=self.offset, spread=self.spread)
        with Progress(console=console) as bar:
            task = bar.add_task("scoring", total=None)
            scores = score(spans, config, lambda done, total: bar.update(task, completed=done, total=total))
        for table in tables(scores):
            console.print(table.rich())
        if self.out is not None:
            _write(scores, self.out)
            console.print(f"wrote {self.out}")


def _write(scores: Scores, path: Path) -> None:
    if path.suffix == ".json":
        text = json.dumps(scores.as_dict(), indent=1) + "\n"
    else:
        text = "\n".join(table.markdown() for table in tables(scores))
    write_text(path, text)

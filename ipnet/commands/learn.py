"""`python -m ipnet learn`: a platform's motion model from recordings whose path and biases are known."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console
from rich.progress import Progress

from ipnet.errors import ConfigError
from ipnet.motion.learn import learn
from ipnet.recordings import Recording, open_recordings
from ipnet.splits import split


@dataclass(frozen=True)
class Learn:
    """Learn how a platform moves, for the prior `motion:`, and how wrong what it says is."""

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]  # recordings to learn from, or folders that hold some
    out: Path  # file to write, .json
    validate: tuple[Path, ...] = ()  # recordings to find its errors by; with --split, found among PATHS
    split: str = ""  # take the recordings of this split from PATHS
    labels: Path | None = None  # biases of recordings whose truth has none: python -m ipnet label

    def run(self, console: Console) -> None:
        """Learn, with a progress bar."""
        training, validation = self._recordings()
        with Progress(console=console) as bar:
            task = bar.add_task("finding errors", total=None)
            card = learn(training, validation, lambda done, total: bar.update(task, completed=done, total=total))
        card.write(self.out)
        console.print(f"wrote {self.out}")

    def _recordings(self) -> tuple[list[Recording], list[Recording]]:
        if not self.split:
            return open_recordings(self.paths, self.labels), open_recordings(self.validate, self.labels)
        if self.validate:
            raise ConfigError("--validate and --split exclude each other: a split says what validates")
        parts = split(self.split)
        training = open_recordings(self.paths, self.labels, names=parts.train)
        return training, open_recordings(self.paths, self.labels, names=parts.validate)

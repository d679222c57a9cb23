"""`python -m ipnet label`: the biases under which the IMU meets the truth, one a recording."""

from dataclasses import dataclass, field
from pathlib import Path

import tyro
from rich.console import Console
from rich.progress import track

from ipnet.errors import LabelError
from ipnet.labels import LabelConfig, label, write_labels
from ipnet.recordings import find
from navcore.errors import NavcoreError
from navcore.readers import open_sequence


@dataclass(frozen=True)
class Label:
    """Find one bias for each recording: that under which its preintegrated IMU meets its truth."""

    paths: tyro.conf.Positional[tuple[Path, ...]]  # recordings, or folders that hold some at any depth
    out: Path  # file to write
    config: LabelConfig = field(default_factory=LabelConfig)

    def run(self, console: Console) -> None:
        """Label them all; one that cannot be labelled is named and does not lose the others."""
        folders = [folder for path in self.paths for folder in find(path)]
        found = []
        for folder in track(folders, "labelling", console=console):
            try:
                found.append(label(open_sequence(folder), self.config))
            except (LabelError, NavcoreError) as error:
                console.print(f"{folder}: {error}", style="red", markup=False, highlight=False)
        write_labels(self.out, found)
        console.print(f"wrote {len(found)} of {len(folders)} labels to {self.out}")

"""`python -m ipnet join`: find how two sources are joined."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from ipnet.files import write_text
from ipnet.joined import find_join, write
from ipnet.recordings import open_recordings
from ipnet.runs import cut

_AXES = ("gyro along the force", "across", "accelerometer along", "across")


@dataclass(frozen=True)
class Join:
    """Choose which of two sources speaks of which axes, on recordings that neither was trained on.

    The file is for ipnet+motion:FILE.
    """

    paths: Annotated[tuple[Path, ...], tyro.conf.Positional]  # recordings, or folders that hold some at any depth
    prior: tuple[str, str]  # the two, as ipnet:sim-rover motion:rover
    out: Path  # file to write
    labels: Path | None = None  # for recordings whose truth has no biases
    seconds: float | None = None  # cut recordings into runs of this length

    def run(self, console: Console) -> None:
        """Find it and write it."""
        spans = cut(open_recordings(self.paths, self.labels), self.seconds)
        found = find_join(self.prior, spans)
        write_text(self.out, write(found))
        said = ", ".join(f"{axis} from {self.prior[k]}" for axis, k in zip(_AXES, found.sources, strict=True))
        console.print(f"wrote {self.out}: {said}", highlight=False)

"""`python -m sim gallery`: pictures of scenes and platforms."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from sim.gallery import PLATFORMS_NAME, SCENES_NAME, gallery


@dataclass(frozen=True)
class Gallery:
    """Show every scene from within and how every platform moves, as two pictures."""

    out: Path  # the folder to write scenes.jpg and platforms.png into
    seed: int = 1  # of the flights

    def run(self, console: Console) -> None:
        """Make them and write them."""
        gallery(self.out, self.seed)
        console.print(f"wrote {self.out / SCENES_NAME} and {self.out / PLATFORMS_NAME}")

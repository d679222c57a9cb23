"""`python -m ipnet predict`: what a network says of a recording."""

from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console

from ipnet.prediction import predict
from navcore.readers import open_sequence


@dataclass(frozen=True)
class Predict:
    """Write a network's statements on a recording, with images or without: t_ns, b_g, b_a, sigma of the six."""

    path: tyro.conf.Positional[Path]  # recording
    weights: str  # a shipped name, or a folder
    out: Path  # CSV to write, which --prior file: reads

    def run(self, console: Console) -> None:
        """Predict."""
        count = predict(open_sequence(self.path), self.weights, self.out)
        console.print(f"wrote {count} statements to {self.out}")

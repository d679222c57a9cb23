"""`python -m ipnet export`: networks for any runtime."""

from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console


@dataclass(frozen=True)
class Export:
    """Write the ONNX files of weights; docs/network.md says what goes in and what comes out."""

    weights: tyro.conf.Positional[str]  # a shipped name, or a folder
    out: Path | None = None  # folder for the files; else beside the weights

    def run(self, console: Console) -> None:
        """Export."""
        from ipnet.export import export_folder
        from ipnet.weights import find

        for path in export_folder(find(self.weights), self.out):
            console.print(f"wrote {path}")

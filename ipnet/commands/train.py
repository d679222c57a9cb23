"""`python -m ipnet train`: networks from recordings whose biases are known."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console

PresetName = Literal["default", "paper"]
NetworkName = Literal["short", "medium", "long"]


@dataclass(frozen=True)
class DeviceFlags:
    """Lightning's own."""

    accelerator: str = "cpu"  # cpu, gpu, auto
    devices: int = 1  # how many
    strategy: str = "auto"  # how they share the work


@dataclass(frozen=True)
class Train:
    """Train networks. Interrupted, the same command goes on after the last epoch that was complete."""

    paths: tyro.conf.Positional[tuple[Path, ...]]  # recordings to learn from, or folders that hold some
    out: Path  # folder for weights, card, checkpoints and logs
    validate: tuple[Path, ...] = ()  # recordings to choose and to calibrate by; with --split, found among PATHS
    split: str = ""  # take the recordings of this split from PATHS
    labels: Path | None = None  # biases of recordings whose truth has none: python -m ipnet label
    preset: PresetName = "default"  # paper: the paper's recipe to the letter
    networks: tuple[NetworkName, ...] = ("short", "medium", "long")  # which of the preset's; medium needs long
    start: str = ""  # weights to begin with: a shipped name or a folder
    any_mount: bool = False  # the IMU may sit in the platform in any way
    epochs: int | None = None  # instead of the preset's
    learning_rate: float | None = None  # instead of the preset's
    windows: int | None = None  # of each recording in an epoch, instead of the preset's
    minutes: float | None = None  # for each network, at most
    seed: int = 1  # of weights and windows
    lightning: DeviceFlags = field(default_factory=DeviceFlags)

    def run(self, console: Console) -> None:
        """Train, export, calibrate, and write the card."""
        from ipnet.project import Project, build
        from ipnet.training import Devices

        changed = {"epochs": self.epochs, "learning_rate": self.learning_rate, "windows": self.windows}
        project = Project(
            self.paths,
            self.validate,
            self.split,
            self.labels,
            self.preset,
            self.networks,
            self.start,
            self.any_mount,
            {key: value for key, value in changed.items() if value is not None},
            self.minutes,
            self.seed,
        )
        flags = self.lightning
        card = build(project, self.out, Devices(flags.accelerator, flags.devices, flags.strategy))
        for name, network in card.networks.items():
            console.print(f"{name}: {network.validation}", highlight=False)
        console.print(f"wrote {self.out}")

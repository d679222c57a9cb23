"""Weights that are shipped, a folder each, and how such a folder is read and written."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ipnet.calibration import ErrorModel
from ipnet.errors import ConfigError
from ipnet.files import write_text
from ipnet.presets import NetworkConfig
from ipnet.windows import Grid

FOLDER = Path(__file__).parent
CARD = "card.json"
NETWORKS = ("short", "medium", "long")
"""By what they see: each is heard until the next one has seen enough."""


@dataclass(frozen=True)
class NetworkCard:
    """What is known of one network.

    Attributes:
        config: its shape.
        every_s: between two of its statements.
        errors: what is wrong with its statements, found on recordings that it was not trained on; in its own frame.
        validation: figures on those, in that frame.
    """

    config: NetworkConfig
    every_s: float
    errors: ErrorModel
    validation: dict[str, Any] = field(default_factory=dict)

    @property
    def grid(self) -> Grid:
        """Its windows."""
        return self.config.grid(self.every_s)

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "seconds": self.grid.seconds,
            "rate_hz": self.grid.rate_hz,
            "every_s": self.every_s,
            "config": vars(self.config),
            "errors": self.errors.as_dict(),
            "validation": self.validation,
        }

    @staticmethod
    def from_dict(content: dict[str, Any]) -> "NetworkCard":
        """From what `as_dict` gave."""
        config = dict(content["config"])
        config["channels"], config["pieces"] = tuple(config["channels"]), tuple(config["pieces"])
        errors = ErrorModel.from_dict(content["errors"])
        return NetworkCard(NetworkConfig(**config), content["every_s"], errors, content["validation"])


@dataclass(frozen=True)
class Card:
    """What is known of weights.

    Attributes:
        networks: by name, of `NETWORKS`.
        training: names of the recordings learned from; those of the weights it began with among them.
        validation: names of the recordings that chose and calibrated.
        made: preset, seed, and whatever else it was made with.
    """

    networks: dict[str, NetworkCard]
    training: tuple[str, ...]
    validation: tuple[str, ...]
    made: dict[str, Any]

    def write(self, folder: Path) -> None:
        """Write `card.json`."""
        content = {**vars(self), "networks": {name: card.as_dict() for name, card in self.networks.items()}}
        write_text(folder / CARD, json.dumps(content, indent=1) + "\n")

    @staticmethod
    def read(folder: Path) -> "Card":
        """The card in a folder.

        Raises:
            ConfigError: the content is not a card.
        """
        try:
            content = json.loads((folder / CARD).read_text(encoding="utf-8"))
            networks = {name: NetworkCard.from_dict(card) for name, card in content["networks"].items()}
            unknown = sorted({*networks} - {*NETWORKS})
            if unknown or not networks:
                raise ConfigError(f"networks are {sorted(networks)}, expected some of {', '.join(NETWORKS)}")
            return Card(networks, tuple(content["training"]), tuple(content["validation"]), content["made"])
        except (ValueError, KeyError, TypeError) as error:
            raise ConfigError(f"{folder / CARD}: {error!r}; expected what `python -m ipnet train` writes") from error


def names() -> list[str]:
    """Of the weights that are shipped."""
    return sorted(p.parent.name for p in FOLDER.glob(f"*/{CARD}"))


def find(name: str) -> Path:
    """The folder of weights: a shipped name, or a folder's path.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    for folder in (FOLDER / name, Path(name)):
        if name and (folder / CARD).is_file():
            return folder
    raise ConfigError(
        f"weights {name!r} are unknown; known are {', '.join(names()) or 'none'}, or a folder with {CARD}"
    )


def uncalibrated() -> ErrorModel:
    """Statements taken at their word."""
    return ErrorModel(1e-12 * np.eye(6), np.ones(6), np.zeros(6))

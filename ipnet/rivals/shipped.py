"""Weights of rivals that are shipped: a folder RIVAL/NAME each."""

from pathlib import Path

from ipnet.errors import ConfigError
from ipnet.weights import CARD

FOLDER = Path(__file__).parent / "weights"


def find(rival: str, name: str) -> Path:
    """The folder of a rival's weights: a shipped name, or a folder's path.

    Raises:
        ConfigError: there are none; the message lists the names.
    """
    for folder in (FOLDER / rival / name, Path(name)):
        if name and (folder / CARD).is_file():
            return folder
    known = ", ".join(sorted(p.parent.name for p in FOLDER.glob(f"{rival}/*/{CARD}"))) or "none"
    raise ConfigError(f"{rival} {name!r} is unknown; known are {known}, or a folder with {CARD}")

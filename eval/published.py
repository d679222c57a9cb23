"""What others have published: position ATE by sequence, as data with its sources in `published.yaml`."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from navcore.calibration import load_yaml

DatasetName = Literal["euroc", "tumvi"]
_FILE = Path(__file__).with_name("published.yaml")


@dataclass(frozen=True)
class System:
    """What one system reached.

    Attributes:
        name, source: of the system, and where it is published.
        ate_m: by sequence; infinite where it diverged.
        mean_m: over all sequences of the data set, where only that is published.
    """

    name: str
    source: str
    ate_m: Mapping[str, float] = field(default_factory=dict)
    mean_m: float | None = None


@dataclass(frozen=True)
class Published:
    """What is published of a data set.

    Attributes:
        title: of the data set.
        sequences: their standard names.
        systems: in the order in which they are shown.
    """

    title: str
    sequences: tuple[str, ...]
    systems: tuple[System, ...]

    @staticmethod
    def of(dataset: DatasetName) -> "Published":
        """The figures that come with this package."""
        content = load_yaml(_FILE)[dataset]
        systems = [System(**s | {"ate_m": MappingProxyType(s.get("ate_m", {}))}) for s in content["systems"]]
        return Published(content["title"], tuple(content["sequences"]), tuple(systems))

    def sequence_in(self, name: str) -> str | None:
        """The standard name within the name of a recording."""
        return sequence_in(name, self.sequences)


def sequence_in(name: str, sequences: Iterable[str]) -> str | None:
    """The one of those names that is within the name of a recording, as `room1` in `dataset-room1_512_16`."""
    for sequence in sequences:
        if re.search(rf"(?<![A-Za-z0-9]){sequence}(?![0-9])", name):
            return sequence
    return None

"""Which recordings are learned from, chosen by, and tested on; nothing that is tested on is ever seen before.

The paper's two tables use different splits of EuRoC, so weights are separate. MH_05_difficult, V1_02_medium and room 6,
which it tests on, were not at hand. Simulated recordings are PLATFORM-SEED, and their seed says what they are for.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from ipnet.errors import ConfigError

STUDY_SEEDS = range(100_001)
"""Of the recordings that studies simulate."""
TRAIN_SEEDS = range(100_001, 200_001)
VALIDATION_SEEDS = range(200_001, 300_001)
TEST_SEEDS = range(300_001, 400_001)
_SIMULATED = re.compile(r"(quadrotor|rover|handheld)-(?:\w+-)*(?:seed)?(\d+)")


@dataclass(frozen=True)
class Split:
    """Names of real recordings.

    Attributes:
        train: learned from.
        validate: chosen by: early stopping, calibration, settings.
        test: only ever scored.
    """

    train: tuple[str, ...]
    validate: tuple[str, ...]
    test: tuple[str, ...]

    def __post_init__(self) -> None:
        shared = {*self.train} & {*self.validate} | {*self.train, *self.validate} & {*self.test}
        if shared:
            raise ConfigError(f"{', '.join(sorted(shared))}: in more than one part of a split")


SPLITS: dict[str, Split] = {
    # Yi et al., table I.
    "euroc": Split(
        ("MH_01_easy", "MH_03_medium", "MH_04_difficult", "V1_03_difficult", "V2_03_difficult"),
        ("MH_02_easy", "V1_01_easy"),
        ("V2_01_easy", "V2_02_medium", "MH_05_difficult", "V1_02_medium"),
    ),
    # Table II, the split of Buchanan et al. (2023). V2_01 validates: both kinds of room and both easy and difficult
    # flight are then left to train.
    "euroc-table2": Split(
        ("MH_01_easy", "MH_03_medium", "V2_03_difficult"),
        ("V2_01_easy",),
        ("MH_02_easy", "MH_04_difficult", "V1_01_easy", "V1_03_difficult", "V2_02_medium"),
    ),
    # What those two do not test: so that for every recording there is something that was made without it. (TUM-VI has
    # too few: rooms 2, 3 and 4 are seen by both of its splits.)
    "euroc-rest": Split(
        ("MH_02_easy", "MH_04_difficult", "V1_03_difficult", "V2_02_medium"),
        ("V1_01_easy",),
        ("MH_01_easy", "MH_03_medium", "V2_01_easy", "V2_03_difficult"),
    ),
    "tumvi": Split(
        ("dataset-room1_512_16", "dataset-room2_512_16", "dataset-room4_512_16"),
        ("dataset-room3_512_16",),
        ("dataset-room5_512_16", "dataset-room6_512_16"),
    ),
    "tumvi-rest": Split(
        ("dataset-room3_512_16", "dataset-room4_512_16", "dataset-room5_512_16"),
        ("dataset-room2_512_16",),
        ("dataset-room1_512_16",),
    ),
}


def split(name: str) -> Split:
    """A split of real recordings by name.

    Raises:
        ConfigError: it is unknown; the message lists the known ones.
    """
    if name not in SPLITS:
        raise ConfigError(f"split {name!r} is unknown; known are {', '.join(SPLITS)}")
    return SPLITS[name]


def unseen_split(recording: str) -> tuple[str, Split] | None:
    """The first split that tests on a recording, with its name; None if none does."""
    return next(((name, parts) for name, parts in SPLITS.items() if recording in parts.test), None)


def leaks(seen: Iterable[str], splits: Iterable[str] = ("euroc", "tumvi")) -> list[str]:
    """The recordings among those that something was made from which it must not have seen.

    Args:
        seen: names of recordings that were trained, tuned or calibrated on.
        splits: names of the splits by which it is tested.

    Raises:
        ConfigError: a split is unknown.
    """
    tested = {name for s in splits for name in split(s).test}
    return sorted(name for name in seen if name in tested or _seed(name) in STUDY_SEEDS or _seed(name) in TEST_SEEDS)


def _seed(name: str) -> int | None:
    """Of a simulated recording."""
    found = _SIMULATED.fullmatch(name)
    return int(found[2]) if found is not None else None

"""Which recordings are learned from, chosen by, and tested on; nothing is in two of them.

The paper's two tables use different splits of EuRoC, so weights are separate. MH_05_difficult and V1_02_medium
are not at hand: both would be tested on.
"""

from dataclasses import dataclass

from ipnet.errors import ConfigError

STUDY_SEEDS = range(1, 100_001)
"""Of simulated recordings in studies; nothing learns from them."""


@dataclass(frozen=True)
class Split:
    """Names of recordings.

    Attributes:
        train: learned from.
        validate: chosen by: early stopping, calibration, settings.
        test: only ever scored.
    """

    train: tuple[str, ...]
    validate: tuple[str, ...]
    test: tuple[str, ...]

    def __post_init__(self) -> None:
        shared = sorted({*self.train} & {*self.validate} | {*self.train, *self.validate} & {*self.test})
        if shared:
            raise ConfigError(f"{', '.join(shared)}: in more than one part of a split")

    @property
    def seen(self) -> tuple[str, ...]:
        """What anything made by this split knows."""
        return self.train + self.validate


def _simulated(platform: str) -> Split:
    """Recordings that `python -m sim fleet` makes: 300 to learn from, 40, and 204."""
    firsts = ((100_001, 300), (200_001, 40), (300_001, 204))
    train, validate, test = (tuple(f"{platform}-{first + k}" for k in range(count)) for first, count in firsts)
    return Split(train, validate, test)


SPLITS: dict[str, Split] = {
    # Yi et al., table I.
    "euroc": Split(
        ("MH_01_easy", "MH_03_medium", "MH_04_difficult", "V1_03_difficult", "V2_03_difficult"),
        ("MH_02_easy", "V1_01_easy"),
        ("V2_01_easy", "V2_02_medium"),
    ),
    # Table II, the split of Buchanan et al. (2023). V2_01 validates: an easy flight in the room of the most training
    # data, so that the three that train hold both kinds of room and both easy and fast flight.
    "euroc-table2": Split(
        ("MH_01_easy", "MH_03_medium", "V2_03_difficult"),
        ("V2_01_easy",),
        ("MH_02_easy", "MH_04_difficult", "V1_01_easy", "V1_03_difficult", "V2_02_medium"),
    ),
    "tumvi": Split(
        ("dataset-room1_512_16", "dataset-room2_512_16", "dataset-room4_512_16"),
        ("dataset-room3_512_16",),
        ("dataset-room5_512_16",),
    ),
    **{f"sim-{platform}": _simulated(platform) for platform in ("quadrotor", "rover", "handheld")},
}


def split(name: str) -> Split:
    """A split by name.

    Raises:
        ConfigError: it is unknown; the message lists the known ones.
    """
    if name not in SPLITS:
        raise ConfigError(f"split {name!r} is unknown; known are {', '.join(SPLITS)}")
    return SPLITS[name]

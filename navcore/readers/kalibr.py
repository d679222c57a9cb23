"""Kalibr's calibration of a recording that cannot hold one itself."""

from pathlib import Path

from navcore.errors import DataError

CAMERAS = ("camchain-imucam.yaml", "camchain.yaml")
"""Names of the file with the cameras."""
IMU = ("imu.yaml", "imu_config.yaml")
"""Names of the file with the IMU's noise."""


def find(places: list[Path], names: tuple[str, ...]) -> Path | None:
    """The first of the files that is there, nearest place first."""
    return next((place / name for place in places for name in names if (place / name).is_file()), None)


def need(places: list[Path], names: tuple[str, ...], whose: Path) -> Path:
    """The same, where there must be one.

    Raises:
        DataError: there is none; the message says where it was looked for.
    """
    found = find(places, names)
    if found is None:
        raise DataError(f"{whose}: no calibration {' or '.join(names)} in {', '.join(str(x) for x in places)}")
    return found

"""Which reader a folder is for, told by what is in it."""

from pathlib import Path

from navcore.errors import DataError
from navcore.readers import asl, euroc, tumvi
from navcore.sequence import Sequence

_READERS = ((euroc.recognises, euroc.read), (tumvi.recognises, tumvi.read))
_LAYOUTS = "EuRoC's (imu0/sensor.yaml) or TUM-VI's (mocap0, or camchain-imucam.yaml beside or above it)"


def open_sequence(path: Path) -> Sequence:
    """The recording at `path`: a folder in EuRoC's or TUM-VI's layout, recognised by its content.

    Raises:
        DataError: no such folder, no known layout, or a fault in one of its files.
    """
    folder, _ = asl.recording_folder(path)
    for recognises, read in _READERS:
        if recognises(folder):
            return read(path)
    raise DataError(f"{folder}: unknown layout; expected {_LAYOUTS}")

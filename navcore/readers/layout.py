"""Which reader a path is for, told by what is in it."""

from pathlib import Path

from navcore.errors import DataError
from navcore.readers import asl, euroc, rosbag, tumvi
from navcore.sequence import Sequence

_READERS = ((euroc.recognises, euroc.read), (tumvi.recognises, tumvi.read))
_LAYOUTS = "EuRoC's (imu0/sensor.yaml) or TUM-VI's (mocap0, or camchain-imucam.yaml beside or above it)"


def open_sequence(path: Path) -> Sequence:
    """The recording at `path`: a folder in EuRoC's or TUM-VI's layout, or a ROS bag, recognised by its content.

    Raises:
        DataError: no such path, no known layout, or a fault in one of its files.
    """
    in_folders = any((path / x).is_dir() for x in ("mav0", "imu0"))
    if not in_folders and rosbag.recognises(path):
        return rosbag.read(path)
    if path.is_file():
        raise DataError(f"{path}: no ROS bag (.bag, .db3, .mcap); expected one, or the folder of a recording")
    folder, _ = asl.recording_folder(path)
    for recognises, read in _READERS:
        if recognises(folder):
            return read(path)
    raise DataError(f"{folder}: unknown layout; expected {_LAYOUTS}")

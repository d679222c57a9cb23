"""Recordings in TUM-VI's layout: motion capture as truth, Kalibr's calibration beside or above `mav0`.

Schubert et al., "The TUM VI benchmark for evaluating visual-inertial odometry" (2018).
"""

from pathlib import Path

from navcore.calibration import Calibration, cameras_from_kalibr, imu_from_yaml
from navcore.errors import DataError
from navcore.readers import asl, kalibr
from navcore.sequence import Sequence

_PARENTS = 2  # folders above the recording in which its calibration may lie
_TRUTH = "mocap0"


def recognises(folder: Path) -> bool:
    """Whether the folder that holds `imu0` is TUM-VI's: it has motion capture, or Kalibr's calibration."""
    return (folder / _TRUTH).is_dir() or kalibr.find(_places(folder), kalibr.CAMERAS) is not None


def read(path: Path) -> Sequence:
    """A recording; `path` is the folder that holds `mav0`, or `mav0` itself. No image is touched.

    Truth is motion capture: poses with gaps, no velocity and no biases.

    Raises:
        DataError: a file or folder is missing, or a row is wrong; the message names file and line.
    """
    folder, name = asl.recording_folder(path)
    mounts = cameras_from_kalibr(kalibr.need(_places(folder), kalibr.CAMERAS, folder))
    calibration = Calibration(imu_from_yaml(kalibr.need(_places(folder), kalibr.IMU, folder)), mounts)
    cameras = asl.camera_folders(folder)
    if len(cameras) > len(mounts):
        raise DataError(f"{folder}: {len(cameras)} camera folders, but {len(mounts)} calibrated cameras")
    imu, imu_notes = asl.read_imu(folder)
    frames, frame_notes = asl.read_frames(cameras, calibration, imu)
    truth = folder / _TRUTH / "data.csv"
    path_WB = asl.read_truth(truth) if truth.is_file() else None
    return Sequence(name, calibration, imu, frames, path_WB, (*imu_notes, *frame_notes))


def _places(folder: Path) -> list[Path]:
    """Where a calibration may lie, nearest first."""
    root = folder.parent if folder.name == "mav0" else folder
    return [folder, root, root / "dso", *root.parents[:_PARENTS]]

"""Recordings in EuRoC's layout: `mav0` with `sensor.yaml` beside every sensor's data.

Burri et al., "The EuRoC micro aerial vehicle datasets" (2016). Feature tracks may take the place of images.
"""

from pathlib import Path

import numpy as np

from navcore.calibration import Calibration, camera_from_euroc, imu_from_yaml, load_yaml, pose_from_euroc
from navcore.errors import DataError
from navcore.readers import asl
from navcore.sequence import Sequence

_TRUTH = "state_groundtruth_estimate0"


def recognises(folder: Path) -> bool:
    """Whether the folder that holds `imu0` is EuRoC's: sensors have a `sensor.yaml`."""
    return any(folder.glob("imu0/sensor.yaml")) or any(folder.glob("cam[0-9]*/sensor.yaml"))


def read(path: Path) -> Sequence:
    """A recording; `path` is the folder that holds `mav0`, or `mav0` itself. No image is touched.

    Raises:
        DataError: a file or folder is missing, or a row is wrong; the message names file and line.
    """
    folder, name = asl.recording_folder(path)
    cameras = asl.camera_folders(folder)
    sensor = folder / "imu0" / "sensor.yaml"
    noise = imu_from_yaml(sensor)
    _check_body(sensor)
    calibration = Calibration(noise, tuple(camera_from_euroc(x / "sensor.yaml") for x in cameras))
    imu, imu_notes = asl.read_imu(folder)
    frames, frame_notes = asl.read_frames(cameras, calibration, imu)
    truth = folder / _TRUTH / "data.csv"
    path_WB = asl.read_truth(truth) if truth.is_file() else None
    return Sequence(name, calibration, imu, frames, path_WB, (*imu_notes, *frame_notes))


def _check_body(sensor: Path) -> None:
    """Raise unless the IMU is the body, as everything else here takes for granted."""
    content = load_yaml(sensor)
    if "T_BS" in content and not np.allclose(pose_from_euroc(content, sensor), np.eye(4)):
        raise DataError(f"{sensor}: T_BS is not the identity; the body frame has to be the IMU's")

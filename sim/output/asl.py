"""Recordings on disk in EuRoC's layout (the ASL format); every number reads back exactly.

Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 2016.
"""

from collections.abc import Mapping
from collections.abc import Sequence as ListLike
from pathlib import Path

import numpy as np
import yaml

from navcore.arrays import Floats, Stamps
from navcore.calibration import CameraMount
from navcore.camera import MODELS
from navcore.imu import ImuNoise, ImuSamples
from navcore.sequence import Frame, Sequence
from navcore.trajectory import Trajectory
from sim.output.images import image_name

_IMU_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
_TRUTH_HEADER = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],"
    "b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)


def write_measurements(folder: Path, sequence: Sequence) -> None:
    """All of a recording but its images, below `folder` (`mav0`)."""
    write_imu(folder, sequence.calibration.imu, sequence.imu)
    if sequence.truth is not None:
        write_truth(folder, sequence.truth)
    for index, mount in enumerate(sequence.calibration.cameras):
        write_camera(folder, index, mount)
        if any(index in f.tracks for f in sequence.frames):
            write_tracks(folder, index, sequence.frames)
        elif any(index in f.images for f in sequence.frames):
            write_image_list(folder, index, sequence.frames)


def write_imu(folder: Path, noise: ImuNoise, samples: ImuSamples) -> None:
    """`imu0`: samples and `sensor.yaml`."""
    sensor = {"sensor_type": "imu", "T_BS": _matrix(np.eye(4)), **vars(noise)}
    _write_sensor(folder / "imu0", sensor)
    _write_table(folder / "imu0" / "data.csv", _IMU_HEADER, samples.t_ns, np.hstack([samples.gyro, samples.accel]))


def write_truth(folder: Path, truth: Trajectory) -> None:
    """`state_groundtruth_estimate0`: pose, velocity and biases; what a truth does not know is nan."""
    place = folder / "state_groundtruth_estimate0"
    sensor = {"sensor_type": "visual-inertial", "T_BS": _matrix(np.eye(4))}
    _write_sensor(place, sensor)
    q_WB_wxyz = np.roll(truth.q_WB, 1, axis=1)
    unknown = np.full((len(truth), 3), np.nan)
    rest = [unknown if x is None else x for x in (truth.v_WB, truth.b_g, truth.b_a)]
    values = np.hstack([truth.p_WB, q_WB_wxyz, *rest])
    _write_table(place / "data.csv", _TRUTH_HEADER, truth.t_ns, values)


def write_camera(folder: Path, index: int, mount: CameraMount) -> None:
    """`camN/sensor.yaml`."""
    camera = mount.camera
    words = next(words for words, model in MODELS.items() if isinstance(camera, model))
    sensor = {
        "sensor_type": "camera",
        "T_BS": _matrix(mount.T_BC),
        "rate_hz": mount.rate_hz,
        "resolution": [camera.width, camera.height],
        "camera_model": words[0],
        "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
        "distortion_model": words[1],
        "distortion_coefficients": list(camera.distortion),
    }
    if mount.dt_cam_imu != 0.0:
        sensor["timeshift_cam_imu"] = mount.dt_cam_imu
    _write_sensor(folder / f"cam{index}", sensor)


def write_image_list(folder: Path, index: int, frames: ListLike[Frame]) -> None:
    """`camN/data.csv`: the images by time."""
    seen = [(f.t_ns, f.images[index]) for f in frames if index in f.images]
    lines = ["#timestamp [ns],filename", *(f"{t},{image_name(t, source)}" for t, source in seen)]
    (folder / f"cam{index}" / "data.csv").write_text("\n".join(lines) + "\n")


def write_tracks(folder: Path, index: int, frames: ListLike[Frame]) -> None:
    """`camN/tracks.csv` in place of images; `timestamps_ns.txt` also has the frames without tracks."""
    lines = ["#timestamp [ns],id,u [px],v [px]"]
    for frame in frames:
        if index not in frame.tracks:
            continue
        seen = frame.tracks[index]
        rows = zip(seen.ids.tolist(), seen.uv.tolist(), strict=True)
        lines += [f"{frame.t_ns},{i},{u!r},{v!r}" for i, (u, v) in rows]
    place = folder / f"cam{index}"
    (place / "tracks.csv").write_text("\n".join(lines) + "\n")
    (place / "timestamps_ns.txt").write_text("".join(f"{f.t_ns}\n" for f in frames))


def _matrix(T: Floats) -> dict[str, object]:
    return {"cols": 4, "rows": 4, "data": T.reshape(-1).tolist()}


def _write_sensor(place: Path, content: Mapping[str, object]) -> None:
    place.mkdir(parents=True, exist_ok=True)
    text = yaml.safe_dump(dict(content), sort_keys=False, default_flow_style=None, width=1000)
    (place / "sensor.yaml").write_text(text)


def _write_table(path: Path, header: str, t_ns: Stamps, values: Floats) -> None:
    rows = zip(t_ns.tolist(), values.tolist(), strict=True)
    lines = [header, *(f"{t},{','.join(map(repr, row))}" for t, row in rows)]
    path.write_text("\n".join(lines) + "\n")

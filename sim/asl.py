"""Recordings on disk in EuRoC's layout (the ASL format): whole folders or none.

Burri et al., "The EuRoC micro aerial vehicle datasets", IJRR 2016.
"""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import yaml

from navcore.arrays import Floats, Image, Stamps
from navcore.calibration import CameraMount
from navcore.camera import MODELS
from navcore.imu import ImuNoise, ImuSamples
from navcore.sequence import Frame
from navcore.trajectory import Trajectory
from sim.errors import ConfigError

_IMU_HEADER = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]"
)
_TRUTH_HEADER = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],"
    "b_w_RS_S_z [rad s^-1],b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)
_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY)


@contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A folder to write into, beside `out`; it becomes `out` if all goes well and vanishes if not.

    Raises:
        ConfigError: `out` is there already and not empty.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out} is there already; expected a new or empty folder")
    partial = out.with_name(out.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    partial.mkdir(parents=True)
    try:
        yield partial
        if out.exists():
            out.rmdir()
        partial.rename(out)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def write_imu(folder: Path, noise: ImuNoise, samples: ImuSamples) -> None:
    """`imu0`: samples and `sensor.yaml`."""
    sensor = {"sensor_type": "imu", "comment": "simulated", "T_BS": _matrix(np.eye(4)), **vars(noise)}
    _write_sensor(folder / "imu0", sensor)
    _write_table(folder / "imu0" / "data.csv", _IMU_HEADER, samples.t_ns, np.hstack([samples.gyro, samples.accel]))


def write_truth(folder: Path, truth: Trajectory) -> None:
    """`state_groundtruth_estimate0`: pose, velocity and biases, of a truth that has them all."""
    assert truth.v_WB is not None and truth.b_g is not None and truth.b_a is not None
    place = folder / "state_groundtruth_estimate0"
    sensor = {"sensor_type": "visual-inertial", "comment": "simulated truth", "T_BS": _matrix(np.eye(4))}
    _write_sensor(place, sensor)
    q_WB_wxyz = np.roll(truth.q_WB, 1, axis=1)
    values = np.hstack([truth.p_WB, q_WB_wxyz, truth.v_WB, truth.b_g, truth.b_a])
    _write_table(place / "data.csv", _TRUTH_HEADER, truth.t_ns, values)


def write_camera(folder: Path, index: int, mount: CameraMount) -> None:
    """`camN/sensor.yaml`."""
    camera = mount.camera
    words = next(words for words, model in MODELS.items() if isinstance(camera, model))
    sensor = {
        "sensor_type": "camera",
        "comment": "simulated",
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


def write_image(folder: Path, index: int, t_ns: int, image: Image) -> None:
    """`camN/data/STAMP.png`."""
    place = folder / f"cam{index}" / "data"
    place.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(".png", image, _PNG)
    assert done
    (place / f"{t_ns}.png").write_bytes(data.tobytes())


def write_image_list(folder: Path, index: int, stamps: Stamps) -> None:
    """`camN/data.csv`: the images by time."""
    lines = ["#timestamp [ns],filename", *(f"{t},{t}.png" for t in stamps.tolist())]
    (folder / f"cam{index}" / "data.csv").write_text("\n".join(lines) + "\n")


def write_tracks(folder: Path, index: int, frames: list[Frame]) -> None:
    """`camN/tracks.csv` in place of images; `timestamps_ns.txt` also has the frames without tracks."""
    lines = ["#timestamp [ns],id,u [px],v [px]"]
    for frame in frames:
        seen = frame.tracks[index]
        rows = zip(seen.ids.tolist(), seen.uv.tolist(), strict=True)
        lines += [f"{frame.t_ns},{i},{u:.6f},{v:.6f}" for i, (u, v) in rows]
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
    lines = [header, *(f"{t}," + ",".join(f"{x:.12g}" for x in row) for t, row in rows)]
    path.write_text("\n".join(lines) + "\n")

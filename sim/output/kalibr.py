"""A calibration in Kalibr's format, for recordings that cannot hold one, and for other people's systems.

https://github.com/ethz-asl/kalibr/wiki/yaml-formats
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import yaml

from navcore.arrays import Floats
from navcore.calibration import Calibration, CameraMount
from navcore.camera import MODELS
from navcore.imu import ImuNoise
from navcore.readers import kalibr, topics


def write_kalibr(folder: Path, calibration: Calibration) -> None:
    """`imu.yaml`, and `camchain-imucam.yaml` if there are cameras."""
    _write(folder / kalibr.IMU[0], _imu(calibration.imu), flow=False)
    if calibration.cameras:
        poses = [_inverse(mount.T_BC) for mount in calibration.cameras]
        chain = {f"cam{k}": _camera(k, mount, poses) for k, mount in enumerate(calibration.cameras)}
        _write(folder / kalibr.CAMERAS[0], chain)


def _imu(noise: ImuNoise) -> dict[str, object]:
    content = {name: value for name, value in vars(noise).items() if name != "rate_hz"}
    return {"rostopic": topics.IMU, "update_rate": noise.rate_hz, **content}


def _camera(index: int, mount: CameraMount, poses: list[Floats]) -> dict[str, object]:
    camera, T_CB = mount.camera, poses[index]
    words = [words for words, model in MODELS.items() if isinstance(camera, model)][-1]  # Kalibr's come last
    content: dict[str, object] = {
        "camera_model": words[0],
        "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
        "distortion_model": words[1],
        "distortion_coeffs": list(camera.distortion),
        "resolution": [camera.width, camera.height],
        "T_cam_imu": T_CB.tolist(),
        "timeshift_cam_imu": mount.dt_cam_imu,
        "rate_hz": mount.rate_hz,
        "rostopic": topics.camera(index),
    }
    if index:
        content["T_cn_cnm1"] = (T_CB @ _inverse(poses[index - 1])).tolist()
    return content


def _inverse(T: Floats) -> Floats:
    """The inverse of a pose (4, 4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse


class _Indented(yaml.SafeDumper):
    """Lists stand further in than their key: OpenCV's reader of YAML wants it so."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)


def _write(path: Path, content: Mapping[str, object], flow: bool | None = None) -> None:
    path.write_text(yaml.dump(dict(content), Dumper=_Indented, sort_keys=False, default_flow_style=flow, width=1000))

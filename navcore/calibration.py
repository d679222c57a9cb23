"""Calibration of a rig: IMU noise, cameras, where they sit and when they see."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from navcore.arrays import Floats, frozen
from navcore.camera import MODELS, Camera
from navcore.errors import DataError
from navcore.imu import ImuNoise


@dataclass(frozen=True)
class CameraMount:
    """One camera of a rig.

    Attributes:
        camera: its intrinsics.
        T_BC: (4, 4) pose of the camera in the body frame (C to B).
        dt_cam_imu: seconds to add to a camera stamp to get IMU time.
        rate_hz: nominal frame rate.
    """

    camera: Camera
    T_BC: Floats
    dt_cam_imu: float = 0.0
    rate_hz: float = 20.0

    def __post_init__(self) -> None:
        T_BC = frozen("T_BC", self.T_BC, np.float64, (4, 4))
        R_BC = T_BC[:3, :3]
        if not np.allclose(R_BC @ R_BC.T, np.eye(3), atol=1e-4) or np.linalg.det(R_BC) < 0.0:
            raise DataError(f"T_BC holds no rotation:\n{T_BC}")
        object.__setattr__(self, "T_BC", T_BC)

    @property
    def R_BC(self) -> Floats:
        """(3, 3), C to B."""
        R_BC: Floats = self.T_BC[:3, :3]
        return R_BC

    @property
    def p_BC(self) -> Floats:
        """(3,) position of the camera in B [m]."""
        p_BC: Floats = self.T_BC[:3, 3]
        return p_BC


@dataclass(frozen=True)
class Calibration:
    """A rig: one IMU (the body frame) and any number of cameras."""

    imu: ImuNoise
    cameras: tuple[CameraMount, ...] = field(default_factory=tuple)


def load_yaml(path: Path) -> dict[str, Any]:
    """A YAML mapping; OpenCV's `%YAML:1.0` first line is tolerated.

    Raises:
        DataError: missing file, no YAML, or no mapping.
    """
    if not path.is_file():
        raise DataError(f"{path}: no such file; expected a calibration")
    try:
        content = yaml.safe_load("\n".join(x for x in path.read_text().splitlines() if not x.startswith("%")))
    except yaml.YAMLError as error:
        raise DataError(f"{path}: not YAML: {error}") from error
    if not isinstance(content, dict):
        raise DataError(f"{path}: expected a YAML mapping, got {type(content).__name__}")
    return content


def _get(content: dict[str, Any], key: str, path: Path) -> Any:
    if key not in content:
        raise DataError(f"{path}: key {key!r} is missing; present are {sorted(content)}")
    return content[key]


def _camera(content: dict[str, Any], coefficients_key: str, path: Path) -> Camera:
    models = (str(_get(content, "camera_model", path)), str(_get(content, "distortion_model", path)))
    if models not in MODELS:
        raise DataError(f"{path}: camera {models} is unknown; known are {sorted(MODELS)}")
    width, height = (int(x) for x in _get(content, "resolution", path))
    fx, fy, cx, cy = (float(x) for x in _get(content, "intrinsics", path))
    k = tuple(float(x) for x in _get(content, coefficients_key, path))
    if len(k) != 4:
        raise DataError(f"{path}: {coefficients_key} has {len(k)} numbers, expected 4")
    return MODELS[models](width, height, fx, fy, cx, cy, (k[0], k[1], k[2], k[3]))


def camera_from_euroc(path: Path) -> CameraMount:
    """A camera from an EuRoC `camN/sensor.yaml`; its `T_BS` is C to B."""
    content = load_yaml(path)
    T_BS = np.array(_get(_get(content, "T_BS", path), "data", path), dtype=np.float64).reshape(4, 4)
    camera = _camera(content, "distortion_coefficients", path)
    offset = float(content.get("timeshift_cam_imu", 0.0))
    return CameraMount(camera, T_BS, offset, float(content.get("rate_hz", 20.0)))


def imu_from_yaml(path: Path) -> ImuNoise:
    """IMU noise from EuRoC's `imu0/sensor.yaml` or Kalibr's `imu.yaml`, with or without the `imu0` level."""
    content = load_yaml(path)
    content = content.get("imu0", content)
    names = ("noise_density", "random_walk")
    sensors = ("gyroscope", "accelerometer")
    values = {f"{s}_{n}": float(_get(content, f"{s}_{n}", path)) for s in sensors for n in names}
    rate = content.get("rate_hz", content.get("update_rate", 200.0))
    return ImuNoise(**values, rate_hz=float(rate))


def cameras_from_kalibr(path: Path, rate_hz: float = 20.0) -> tuple[CameraMount, ...]:
    """Cameras from Kalibr's `camchain-imucam.yaml`.

    Its `T_cam_imu` is B to C, its time shift is ours: t_imu = t_cam + shift.
    """
    content = load_yaml(path)
    mounts = []
    for name in sorted(k for k in content if str(k).startswith("cam")):
        entry = content[name]
        T_CB: Floats = np.array(_get(entry, "T_cam_imu", path), dtype=np.float64).reshape(4, 4)
        offset = float(entry.get("timeshift_cam_imu", 0.0))
        camera = _camera(entry, "distortion_coeffs", path)
        T_BC = np.linalg.inv(T_CB).astype(np.float64)
        mounts.append(CameraMount(camera, T_BC, offset, rate_hz))
    if not mounts:
        raise DataError(f"{path}: no camera (cam0, cam1, ...) in it")
    return tuple(mounts)

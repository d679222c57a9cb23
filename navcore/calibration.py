"""Calibration of a rig: IMU noise, cameras, where they sit and when they see."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from navcore.arrays import Floats, frozen
from navcore.camera import MODELS, Camera
from navcore.errors import DataError
from navcore.imu import ImuNoise

_FRAME_RATE = 20.0  # Hz, where a calibration does not say
_IMU_RATE = 200.0
_VIBRATION_SHARE = 0.1
"""Of real IMUs that say nothing of it: from EuRoC's Machine Hall recordings (docs/filter.md, section 2.4)."""


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


def _numbers(content: dict[str, Any], key: str, path: Path, shape: tuple[int, ...]) -> Floats:
    """The finite numbers under a key, however they are nested, in this shape."""
    value = _get(content, key, path)
    count = math.prod(shape)
    try:
        numbers: Floats = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{path}: {key} is {value!r}, expected {count} numbers") from error
    if numbers.size != count or not np.isfinite(numbers).all():
        raise DataError(f"{path}: {key} has {numbers.size} numbers, expected {count}, all finite: {value!r}")
    return numbers.reshape(shape)


def _number(content: dict[str, Any], key: str, path: Path, default: float) -> float:
    return float(_numbers(content, key, path, ())) if key in content else default


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Put the file before what a value object says of its values."""
    try:
        yield
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _camera(content: dict[str, Any], coefficients_key: str, path: Path) -> Camera:
    models = (str(_get(content, "camera_model", path)), str(_get(content, "distortion_model", path)))
    if models not in MODELS:
        raise DataError(f"{path}: camera {models} is unknown; known are {sorted(MODELS)}")
    width, height = (int(x) for x in _numbers(content, "resolution", path, (2,)))
    fx, fy, cx, cy = _numbers(content, "intrinsics", path, (4,)).tolist()
    k1, k2, k3, k4 = _numbers(content, coefficients_key, path, (4,)).tolist()
    with _named(path):
        return MODELS[models](width, height, fx, fy, cx, cy, (k1, k2, k3, k4))


def camera_from_euroc(path: Path) -> CameraMount:
    """A camera from an EuRoC `camN/sensor.yaml`; its `T_BS` is C to B.

    Raises:
        DataError: a key is missing or does not hold what it should; the message names the file.
    """
    content = load_yaml(path)
    T_BC = pose_from_euroc(content, path)
    camera = _camera(content, "distortion_coefficients", path)
    offset = _number(content, "timeshift_cam_imu", path, 0.0)
    with _named(path):
        return CameraMount(camera, T_BC, offset, _number(content, "rate_hz", path, _FRAME_RATE))


def pose_from_euroc(content: dict[str, Any], path: Path) -> Floats:
    """(4, 4) `T_BS` of a `sensor.yaml`: the sensor's pose in the body frame."""
    T_BS = _get(content, "T_BS", path)
    if not isinstance(T_BS, dict):
        raise DataError(f"{path}: T_BS is {T_BS!r}, expected a mapping with 16 numbers under data")
    return _numbers(T_BS, "data", path, (4, 4))


def imu_from_yaml(path: Path) -> ImuNoise:
    """IMU noise from EuRoC's `imu0/sensor.yaml` or Kalibr's `imu.yaml`, with or without the `imu0` level.

    It may have a `vibration_share` beside their own keys.

    Raises:
        DataError: a key is missing or does not hold what it should; the message names the file.
    """
    content = load_yaml(path)
    content = content.get("imu0", content)
    sensors, kinds = ("gyroscope", "accelerometer"), ("noise_density", "random_walk")
    names = [f"{sensor}_{kind}" for sensor in sensors for kind in kinds]
    values = {name: float(_numbers(content, name, path, ())) for name in names}
    rate_key = "rate_hz" if "rate_hz" in content else "update_rate"
    with _named(path):
        share = _number(content, "vibration_share", path, _VIBRATION_SHARE)
        return ImuNoise(**values, rate_hz=_number(content, rate_key, path, _IMU_RATE), vibration_share=share)


def cameras_from_kalibr(path: Path) -> tuple[CameraMount, ...]:
    """Cameras from Kalibr's `camchain-imucam.yaml`.

    Its `T_cam_imu` is B to C, its time shift is ours: t_imu = t_cam + shift. A camera may have a `rate_hz`
    beside Kalibr's own keys.

    Raises:
        DataError: a key is missing or does not hold what it should; the message names the file.
    """
    content = load_yaml(path)
    mounts = []
    for name in sorted(k for k in content if str(k).startswith("cam")):
        entry = content[name]
        if not isinstance(entry, dict):
            raise DataError(f"{path}: {name} is {entry!r}, expected the keys of a camera")
        T_CB = _numbers(entry, "T_cam_imu", path, (4, 4))
        offset = _number(entry, "timeshift_cam_imu", path, 0.0)
        camera = _camera(entry, "distortion_coeffs", path)
        with _named(path):
            mounts.append(CameraMount(camera, _inverse(T_CB), offset, _number(entry, "rate_hz", path, _FRAME_RATE)))
    if not mounts:
        raise DataError(f"{path}: no camera (cam0, cam1, ...) in it")
    return tuple(mounts)


def _inverse(T: Floats) -> Floats:
    """The inverse of a pose (4, 4); its rotation need not be one to the last digit."""
    if abs(np.linalg.det(T)) < 0.5:
        raise DataError(f"T_cam_imu holds no rotation:\n{T}")
    T_inverse: Floats = np.linalg.inv(T).astype(np.float64)
    return T_inverse

"""Rigs: an IMU grade and cameras on a body."""

import numpy as np

from navcore import so3
from navcore.arrays import Floats
from navcore.calibration import Calibration, CameraMount
from navcore.camera import PinholeRadtan
from navcore.imu import ImuNoise
from sim.errors import ConfigError

MAX_CAMERAS = 2

_R_BC_LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # C looks along B's x, its y down
_PITCH_DOWN_DEG = 12.0
_BASELINE = 0.11  # m
_LEFT = PinholeRadtan(
    752, 480, 458.654, 457.296, 367.215, 248.375, (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)
)
_RIGHT = PinholeRadtan(
    752, 480, 457.587, 456.134, 379.999, 255.238, (-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05)
)


def euroc_like(noise: ImuNoise, cameras: int = 1) -> Calibration:
    """EuRoC's cameras (intrinsics of its cam0 and cam1) looking ahead of B and a little down, 20 frames/s.

    Raises:
        ConfigError: `cameras` is neither 1 nor 2.
    """
    if not 1 <= cameras <= MAX_CAMERAS:
        raise ConfigError(f"{cameras} cameras were asked for; this rig has 1 or {MAX_CAMERAS}")
    mounts = [
        CameraMount(_LEFT, _pose(0.5 * _BASELINE, (0.0, 0.003, -0.004)), rate_hz=20.0),
        CameraMount(_RIGHT, _pose(-0.5 * _BASELINE, (0.002, -0.004, 0.005)), rate_hz=20.0),
    ]
    return Calibration(noise, tuple(mounts[:cameras]))


def _pose(y: float, misalignment: tuple[float, float, float]) -> Floats:
    """(4, 4) T_BC of a camera `y` m to the left, turned by small angles as real mounts are."""
    T_BC = np.eye(4)
    down = so3.exp(np.array([0.0, np.deg2rad(_PITCH_DOWN_DEG), 0.0]))
    T_BC[:3, :3] = down @ _R_BC_LEVEL @ so3.exp(np.array(misalignment))
    T_BC[:3, 3] = (0.06, y, -0.015)
    return T_BC

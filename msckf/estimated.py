"""What of the calibration is estimated in flight."""

from dataclasses import dataclass

import numpy as np

from msckf.config import CalibrationConfig
from msckf.views import INTRINSICS_SIZE
from navcore.arrays import Floats

POSE_SIZE = 6


@dataclass(frozen=True)
class Estimated:
    """Which parts of the calibration are error states.

    Attributes:
        time_offset: `dt_cam_imu`, one for all cameras.
        extrinsics: `dtheta, dp` of each camera in B.
        intrinsics: focal lengths, principal point and distortion of each camera.
    """

    time_offset: bool = False
    extrinsics: bool = False
    intrinsics: bool = False

    @property
    def camera_size(self) -> int:
        """Number of error states of one camera, extrinsics first."""
        return POSE_SIZE * self.extrinsics + INTRINSICS_SIZE * self.intrinsics

    @staticmethod
    def of(config: CalibrationConfig) -> "Estimated":
        """As configured."""
        return Estimated(config.time_offset, config.extrinsics, config.intrinsics)

    def sigmas(self, config: CalibrationConfig, cameras: int) -> Floats:
        """Standard deviations of the error states beforehand, in their order."""
        pose = np.repeat([config.rotation_sigma, config.position_sigma], 3)
        lens = np.repeat([config.focal_sigma, config.centre_sigma, config.distortion_sigma], [2, 2, 4])
        one = np.concatenate([pose[: POSE_SIZE * self.extrinsics], lens[: INTRINSICS_SIZE * self.intrinsics]])
        return np.concatenate([np.full(int(self.time_offset), config.time_sigma), np.tile(one, cameras)])

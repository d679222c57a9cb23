"""The filter's settings; units stand in the comments."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from navcore.pixel_noise import PixelNoiseConfig
from navcore.prior import PriorMode
from navcore.settings import with_overrides
from navcore.stillness import StillnessConfig
from navcore.tracker import TrackerConfig

StartMode = Literal["auto", "static", "moving", "truth"]
MarginalOrder = Literal["oldest", "keyframes"]


@dataclass(frozen=True)
class VisionConfig(PixelNoiseConfig):
    """Measurements of features over the window of clones."""

    clones: int = 11  # poses in the window
    marginalise: MarginalOrder = "oldest"  # pose that leaves; `keyframes`: the last one, where the view hardly moved
    keyframe_disparity: float = 5.0  # px, motion of the view since the pose before it that makes a pose a keyframe
    min_views: int = 4  # views that a feature needs to be used
    min_parallax: float = 3.0  # standard deviations by which an inverse range must exceed zero to be believed
    max_features: int = 40  # used at one frame
    landmarks: int = 40  # features kept in the state once they outlast the window
    landmark_parallax: float = 20.0  # like min_parallax, for a feature that is to be kept
    max_landmark_depth: float = 1000.0  # m, a landmark farther away ends
    max_depth: float = 100.0  # m
    min_depth: float = 0.1  # m
    unsure_velocity: float = 0.01  # m/s, standard deviation past which updates are iterated
    gate_probability: float = 0.99  # of the chi-square test, feature by feature
    fej: bool = True  # linearise at first estimates


@dataclass(frozen=True)
class CalibrationConfig:
    """What of the calibration is estimated, beginning at its values, and how well it is known beforehand."""

    extrinsics: bool = True  # where the cameras sit
    rotation_sigma: float = 0.005  # rad
    position_sigma: float = 0.003  # m
    time_offset: bool = False  # between camera and IMU, one for all cameras
    time_sigma: float = 0.005  # s
    intrinsics: bool = False  # how the cameras project
    focal_sigma: float = 2.5  # px, of focal lengths
    centre_sigma: float = 2.5  # px, of the principal point
    distortion_sigma: float = 0.005  # of each coefficient


@dataclass(frozen=True)
class StartConfig:
    """How the filter begins, and what it knows of the biases then."""

    mode: StartMode = "auto"
    static_s: float = 0.8  # s, quiet stretch that a static start needs
    static_disparity: float = 1.0  # px, motion of the image over that stretch
    moving_s: float = 3.0  # s, longest window of a moving start
    least_moving_s: float = 0.8  # s, shortest
    keyframe_s: float = 0.1  # s, spacing of its poses, wider where there would be more than `poses`
    poses: int = 21  # in a window
    features: int = 100  # in a window, those that were seen longest
    gyro_noise: float = 3.0  # times what the calibration says, in a window: it knows no vibration
    accel_noise: float = 8.0  # likewise
    gyro_bias_sigma: float = 0.1  # rad/s, without a device prior
    accel_bias_sigma: float = 0.2  # m/s^2, without a device prior
    max_velocity_sigma: float = 0.05  # m/s, a moving start is accepted below it
    max_tilt_sigma: float = 0.03  # rad, likewise
    max_scale_sigma: float = 0.02  # of the window's path, likewise
    patience_s: float = 2.6  # s, from this window on velocity and tilt may be known half as well, the scale not at all
    max_cost: float = 1.5  # chi-square of the window by degree of freedom, likewise


@dataclass(frozen=True)
class StandstillConfig(StillnessConfig):
    """Standing still, and how still that is."""

    position_sigma: float = 5e-4  # m, how well the pose is known to be the same
    rotation_sigma: float = 5e-4  # rad, what the test of the image lets pass
    velocity_sigma: float = 5e-3  # m/s
    gate_probability: float = 0.99  # of the chi-square test by which the body has begun to move


@dataclass(frozen=True)
class PriorConfig:
    """How a bias prior enters."""

    mode: PriorMode = "modelled"  # `plain` is the paper's: fixed weight, no model of the prior's own error
    weight: float = 100.0  # W of the plain mode, in 1/(rad/s) and 1/(m/s^2)
    student_dof: float = 5.0  # degrees of freedom of the robust weight; large is Gaussian
    surprise_probability: float = 0.999  # an innovation beyond this quantile is a surprise
    surprises: int = 5  # in a row, after which the biases are doubted


@dataclass(frozen=True)
class HealthConfig:
    """Limits behind `Health`."""

    min_tracked: int = 8  # features, fewer are no vision
    blind_s: float = 0.6  # s without a visual correction, then INERTIAL_ONLY
    max_speed: float = 30.0  # m/s
    max_position_sigma: float = 50.0  # m, of what was added since vision last corrected
    max_velocity_sigma: float = 10.0  # m/s
    max_imu_gap_s: float = 0.02  # s, a longer one is reported
    lost_imu_gap_s: float = 1.0  # s, a longer one cannot be bridged
    contradicted_s: float = 0.5  # s in which vision must contradict the state before another is looked for
    contradicted_share: float = 0.25  # features used to features refused, below which it does
    contradicted_features: int = 20  # features refused in that time, or used in the next
    contradicted_followed: float = 0.3  # of the features followed, likewise refused
    cut_share: float = 0.1  # of the features, if fewer are followed into the next frame the view is another one
    confirmed_s: float = 1.0  # s without contradiction in which more must be used than refused to end it
    max_ahead_s: float = 10.0  # s, a frame farther past the last one and the IMU is refused, unless the next follows it


@dataclass(frozen=True)
class FilterConfig:
    """All settings of the filter."""

    vision: VisionConfig = field(default_factory=VisionConfig)
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    start: StartConfig = field(default_factory=StartConfig)
    standstill: StandstillConfig = field(default_factory=StandstillConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)
    health: HealthConfig = field(default_factory=HealthConfig)
    cameras: int = 1  # how many of the rig's cameras are used

    def with_overrides(self, overrides: Mapping[str, Any]) -> "FilterConfig":
        """A copy with settings replaced by dotted name, as `{"vision.fej": False}`.

        Raises:
            ConfigError: a name is unknown; the message lists the known ones.
        """
        return with_overrides(self, overrides)

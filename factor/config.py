"""The smoother's settings; units stand in the comments."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from navcore.pixel_noise import PixelNoiseConfig
from navcore.prior import PriorMode
from navcore.settings import with_overrides
from navcore.stillness import StillnessConfig
from navcore.tracker import TrackerConfig

Preintegration = Literal["estimate", "prior"]


@dataclass(frozen=True)
class WindowConfig(PixelNoiseConfig):
    """The keyframes and what is seen from them."""

    keyframes: int = 10  # in the window, the newest frame not counted
    min_views: int = 3  # that a feature needs to be used
    min_depth: float = 0.2  # m, a point closer to the body is none
    max_depth: float = 100.0  # m
    gate_probability: float = 0.99  # of the chi-square test of what a point leaves unexplained, feature by feature
    disparity: float = 10.0  # px, motion of the view since the last keyframe, rotation taken out, that makes one
    common: float = 0.6  # of the last keyframe's features, if fewer are followed the frame becomes one
    longest_s: float = 1.0  # s between keyframes
    iterations: int = 4  # of Gauss-Newton at a frame, at most
    settled: float = 1e-3  # norm of a step that ends them
    rest_sigma: float = 5e-3  # m/s, of a body that stands still
    same_sigma: float = 5e-4  # rad, m, likewise


@dataclass(frozen=True)
class PriorConfig:
    """How a bias prior enters."""

    mode: PriorMode = "modelled"  # `plain` is the paper's: fixed weight, on every keyframe
    weight: float = 100.0  # W of the plain mode, in 1/(rad/s) and 1/(m/s^2)
    student_dof: float = 5.0  # degrees of freedom of the robust weight; large is Gaussian
    preintegration: Preintegration = "estimate"  # bias at which samples are integrated; `prior`: the paper's figure 2


@dataclass(frozen=True)
class HealthConfig:
    """Limits behind `Health`."""

    min_used: int = 4  # features, fewer are no vision
    blind_s: float = 0.6  # s without a visual correction, then INERTIAL_ONLY
    max_speed: float = 30.0  # m/s
    max_velocity_sigma: float = 10.0  # m/s
    max_imu_gap_s: float = 0.02  # s, a longer one is reported
    lost_imu_gap_s: float = 1.0  # s, a longer one cannot be bridged
    max_ahead_s: float = 10.0  # s, a frame farther past the last one and the IMU is refused, unless the next follows it


@dataclass(frozen=True)
class SmootherConfig:
    """All settings of the smoother."""

    window: WindowConfig = field(default_factory=WindowConfig)
    tracker: TrackerConfig = field(default_factory=TrackerConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)
    stillness: StillnessConfig = field(default_factory=StillnessConfig)
    health: HealthConfig = field(default_factory=HealthConfig)
    cameras: int = 1  # how many of the rig's cameras are used

    def with_overrides(self, overrides: Mapping[str, Any]) -> "SmootherConfig":
        """A copy with settings replaced by dotted name, as `{"window.keyframes": 15}`.

        Raises:
            ConfigError: a name is unknown; the message lists the known ones.
        """
        return with_overrides(self, overrides)

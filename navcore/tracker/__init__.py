"""Images become feature tracks: corners, pyramidal KLT led by the gyro, outliers told by epipolar geometry."""

from navcore.tracker.config import TrackerConfig
from navcore.tracker.epipolar import two_point_inliers
from navcore.tracker.quality import ImageQuality
from navcore.tracker.stereo import StereoMatcher
from navcore.tracker.tracker import Numbers, Tracker

__all__ = ["ImageQuality", "Numbers", "StereoMatcher", "Tracker", "TrackerConfig", "two_point_inliers"]

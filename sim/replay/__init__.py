"""Real recordings re-rendered: their IMU as it is, their truth smoothed with it, new images along it."""

from sim.replay.replay import replayed
from sim.replay.smoothed import SmoothedTruth, smooth_truth

__all__ = ["SmoothedTruth", "replayed", "smooth_truth"]

"""A fixed-lag smoother on GTSAM for one IMU and cameras, with a bias prior as factors: the filter's comparator."""

from factor.config import SmootherConfig
from factor.smoother import Smoother

__all__ = ["Smoother", "SmootherConfig"]

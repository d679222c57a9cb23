"""An error-state MSCKF for one IMU and cameras that accepts a bias prior as a pseudo-measurement."""

from msckf.config import FilterConfig
from msckf.filter import Filter

__all__ = ["Filter", "FilterConfig"]

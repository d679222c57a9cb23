"""A simulator of moving platforms with cameras and an IMU: truth, samples, tracks and images."""

from sim.degrade.schedule import Schedule
from sim.platforms import simulate_motion
from sim.points import simulate_points

__all__ = ["Schedule", "simulate_motion", "simulate_points"]

"""Platforms as physics: each file makes a motion, its model stands beside it."""

from sim.platforms.registry import DIFFICULTIES, PLATFORMS, simulate_motion

__all__ = ["DIFFICULTIES", "PLATFORMS", "simulate_motion"]

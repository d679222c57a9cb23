"""The platforms that can be flown, driven or carried, by name."""

from collections.abc import Callable

import numpy as np

from sim import quadrotor
from sim.errors import ConfigError
from sim.motion import Motion
from sim.streams import Streams


def _quadrotor(seconds: float, moving_start: bool, rng: np.random.Generator) -> Motion:
    return quadrotor.fly(seconds, rng, quadrotor.QuadrotorFlight(moving_start=moving_start))


PLATFORMS: dict[str, Callable[[float, bool, np.random.Generator], Motion]] = {"quadrotor": _quadrotor}
"""Makers of motion by platform: (seconds, moving_start, rng)."""


def simulate_motion(
    platform: str = "quadrotor", seconds: float = 60.0, seed: int = 1, moving_start: bool = False
) -> Motion:
    """The motion of a platform; the same arguments give the same motion.

    Raises:
        ConfigError: an unknown platform (the message lists the known ones), or no time to move.
    """
    if platform not in PLATFORMS:
        raise ConfigError(f"platform {platform!r} is unknown; known are {sorted(PLATFORMS)}")
    return PLATFORMS[platform](seconds, moving_start, Streams.of(seed).motion)

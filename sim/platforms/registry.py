"""The platforms that can be flown, driven or carried, by name."""

import math
from collections.abc import Callable

import numpy as np

from sim.errors import ConfigError
from sim.motion import Motion
from sim.platforms import handheld, quadrotor, rover
from sim.streams import Streams

DIFFICULTIES = ("easy", "medium", "difficult")
"""How a platform may move: how fast, how suddenly, and the rover on how rough a ground."""


def _quadrotor(seconds: float, moving_start: bool, difficulty: str, rng: np.random.Generator) -> Motion:
    return quadrotor.fly(seconds, rng, quadrotor.FLIGHTS[difficulty], moving_start)


def _handheld(seconds: float, moving_start: bool, difficulty: str, rng: np.random.Generator) -> Motion:
    return handheld.carry(seconds, rng, handheld.WALKS[difficulty], moving_start)


def _rover(seconds: float, moving_start: bool, difficulty: str, rng: np.random.Generator) -> Motion:
    return rover.drive(seconds, rng, rover.DRIVES[difficulty], moving_start)


PLATFORMS: dict[str, Callable[[float, bool, str, np.random.Generator], Motion]] = {
    "quadrotor": _quadrotor,
    "handheld": _handheld,
    "rover": _rover,
}
"""Makers of motion by platform: (seconds, moving_start, difficulty, rng)."""


def simulate_motion(
    platform: str = "quadrotor",
    seconds: float = 60.0,
    seed: int = 1,
    moving_start: bool = False,
    difficulty: str = "medium",
) -> Motion:
    """The motion of a platform; the same arguments give the same motion.

    Args:
        platform: one of `PLATFORMS`.
        seconds: length of the motion.
        seed: draws the path and whatever else is random.
        moving_start: begin in full motion instead of standing still for two seconds.
        difficulty: one of `DIFFICULTIES`.

    Raises:
        ConfigError: an unknown platform or difficulty (the message lists the known ones), or no time to move.
    """
    if platform not in PLATFORMS:
        raise ConfigError(f"platform {platform!r} is unknown; known are {sorted(PLATFORMS)}")
    if difficulty not in DIFFICULTIES:
        raise ConfigError(f"difficulty {difficulty!r} is unknown; known are {', '.join(DIFFICULTIES)}")
    if not 0.0 < seconds < math.inf:
        raise ConfigError(f"a motion of {seconds} s was asked for; expected a time above 0")
    return PLATFORMS[platform](seconds, moving_start, difficulty, Streams.of(seed).motion)

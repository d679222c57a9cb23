"""The scenes by name."""

from collections.abc import Callable

import numpy as np

from navcore.arrays import Vectors
from sim.errors import ConfigError
from sim.world.layout import Layout
from sim.world.scenes.corridor import corridor
from sim.world.scenes.hall import hall
from sim.world.scenes.room import room
from sim.world.scenes.yard import yard
from sim.world.way import Way

SCENES: dict[str, Callable[[Way, np.random.Generator], Layout]] = {
    "room": room,
    "hall": hall,
    "corridor": corridor,
    "yard": yard,
}
"""Makers of layouts by scene: (way, rng)."""


def make_layout(scene: str, path: Vectors, rng: np.random.Generator) -> Layout:
    """A world of a kind around a path; the same path and generator state give the same world.

    Args:
        scene: one of `SCENES`.
        path: (N, 3) m in W, where the body goes: nothing stands in its way.
        rng: draws it.

    Raises:
        ConfigError: an unknown scene (the message lists the known ones), or a path without points.
    """
    check_scene(scene)
    return SCENES[scene](Way.of(path), rng)


def check_scene(scene: str) -> None:
    """Raise unless there is such a scene.

    Raises:
        ConfigError: there is none; the message lists the known ones.
    """
    if scene not in SCENES:
        raise ConfigError(f"scene {scene!r} is unknown; known are {sorted(SCENES)}")

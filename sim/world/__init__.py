"""Worlds to move through: their geometry, their look, their light."""

from sim.world.layout import SCENES, Layout, make_layout
from sim.world.scene import Scene, build

__all__ = ["SCENES", "Layout", "Scene", "build", "make_layout"]

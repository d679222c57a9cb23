"""Worlds to move through: their geometry, their look, their light, and what moves in them."""

from sim.world.layout import Layout
from sim.world.living import make_scene
from sim.world.movers import Mover, make_movers
from sim.world.scene import Scene, build
from sim.world.scenes import SCENES, check_scene, make_layout
from sim.world.switches import Switches

__all__ = [
    "SCENES",
    "Layout",
    "Mover",
    "Scene",
    "Switches",
    "build",
    "check_scene",
    "make_layout",
    "make_movers",
    "make_scene",
]

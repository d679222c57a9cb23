"""The kinds of worlds, each fitted to the path that goes through it."""

from sim.world.scenes.registry import SCENES, make_layout

__all__ = ["SCENES", "make_layout"]

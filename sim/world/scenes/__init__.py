"""The kinds of worlds, each fitted to the path that goes through it."""

from sim.world.scenes.registry import SCENES, check_scene, make_layout

__all__ = ["SCENES", "check_scene", "make_layout"]

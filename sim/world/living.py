"""A world around a motion: what stands still, and, if it is asked for, what moves in it and lamps that switch."""

import numpy as np

from sim.errors import ConfigError
from sim.motion import Motion
from sim.world.movers import make_movers
from sim.world.scene import Scene, build
from sim.world.scenes import make_layout
from sim.world.switches import Switches


def make_scene(scene: str, motion: Motion, rng: np.random.Generator, movers: int = 0, switching: bool = False) -> Scene:
    """A world of a kind; with movers or switching lamps it is the same world otherwise.

    Args:
        scene: one of `SCENES`.
        motion: of the body; nothing stands in its way, and movers keep from it. Time counts from its start.
        rng: draws all of it.
        movers: how many things move through it.
        switching: lamps go out and on.

    Raises:
        ConfigError: an unknown scene, no room for so many movers, or lamps are to switch where there are none.
    """
    of_movers, of_switches = rng.spawn(2)
    layout = make_layout(scene, motion.p_WB, rng)
    if switching and not layout.lamp_places:
        raise ConfigError(f"the scene {scene!r} has no lamps that could switch")
    things = make_movers(movers, layout, motion.p_WB, motion.duration_s, of_movers)
    return build(layout, rng, things, Switches.of(len(layout.lamp_places), of_switches) if switching else None)

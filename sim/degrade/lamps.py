"""Lights that go out and on: each lamp lights a part of the world's directions, and switches at once."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Vectors
from sim.degrade.schedule import Degradation
from sim.degrade.sphere import evenly
from sim.degrade.switching import switch_times
from sim.degrade.view import Light, View, coarse


@dataclass(frozen=True)
class Switching:
    """One severity.

    Attributes:
        lost: share of its light that a part of the world loses when its lamp is out.
        dwell_s: mean time between two switchings of a lamp.
    """

    lost: float
    dwell_s: float


LIGHT_SWITCH = (
    Switching(0.25, 3.0),
    Switching(0.48, 2.5),
    Switching(0.62, 2.0),
    Switching(0.75, 1.2),
    Switching(0.95, 0.5),
)
"""By severity."""
_LAMPS = 8
_FOCUS = 6.0  # how sharply one lamp's part ends at another's


def light_switch(view: View, light: Light, degradation: Degradation) -> None:
    """Darken the parts of the world whose lamps are out."""
    switching = LIGHT_SWITCH[degradation.severity - 1]
    rng = view.generator("light_switch")
    lamps_W = evenly(_LAMPS, rng)
    out = _out(view.t_s, degradation, switching, rng)
    grid = coarse(view.mount.camera)
    directions_W = grid.rays @ view.R_WC(np.zeros(1))[0].T
    lost = switching.lost * (_shares(directions_W, lamps_W) @ out)
    light.attenuate(grid.fill(1.0 - lost))


def _shares(directions: Vectors, lamps: Vectors) -> Floats:
    """(..., L): which part of its light a direction has from each lamp."""
    weight = np.exp(_FOCUS * (directions @ lamps.T - 1.0))
    shares: Floats = weight / weight.sum(axis=-1, keepdims=True)
    return shares


def _out(t_s: float, degradation: Degradation, switching: Switching, rng: np.random.Generator) -> Floats:
    """(L,): 1 for a lamp that is out, 0 for one that is on; every other lamp is out at first."""
    states = []
    for first, own in enumerate(rng.spawn(_LAMPS)):
        # The first switching of each lamp comes at a time of its own within its first dwell.
        earlier_s = own.uniform() * 0.5 * switching.dwell_s
        times = switch_times(own, degradation, switching.dwell_s)[1:] - earlier_s
        states.append((first + 1 + int(np.searchsorted(times, t_s, side="right"))) % 2)
    return np.array(states, dtype=np.float64)

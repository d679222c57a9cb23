"""Paths through the scenes: of a simulated platform, and as real recordings have them."""

import numpy as np
import pytest

from navcore.arrays import Vectors
from sim.motion import Motion


@pytest.fixture(scope="session")
def paths(flight: Motion) -> dict[str, Vectors]:
    """Positions (N, 3) m: from the floor of the simulator's box, and long and off the origin, partly below zero."""
    t = np.linspace(0.0, 1.0, 3000)[:, None]
    waves = np.sin(2.0 * np.pi * t * [1.0, 2.0, 3.0] + [0.3, 1.0, -0.5])
    long = np.array([30.0, -12.0, 2.5]) + [9.0, 6.0, 3.5] * waves
    level = np.array([-4.0, 9.0, 1.4]) + [1.8, 2.5, 0.2] * waves
    return {"flight": flight.p_WB, "long": long, "level": level}


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few texels: for tests in which how a scene looks does not matter."""
    monkeypatch.setattr("sim.world.surface._TEXELS_PER_M", (5.0, 25.0))

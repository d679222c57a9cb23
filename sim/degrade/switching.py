"""When something switches, again and again, while a degradation lasts."""

import numpy as np

from navcore.arrays import Floats
from sim.degrade.schedule import Degradation


def switch_times(rng: np.random.Generator, degradation: Degradation, dwell_s: float) -> Floats:
    """(N,) s from the first frame: the start of the degradation, then every half to one and a half `dwell_s`."""
    n = int((degradation.end_s - degradation.start_s) / (0.5 * dwell_s)) + 1
    waits = rng.uniform(0.5, 1.5, size=n) * dwell_s
    times: Floats = degradation.start_s + np.concatenate([[0.0], np.cumsum(waits)])
    return times

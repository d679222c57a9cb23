"""Lamps that go out and on, each at times of its own."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Mask

_ON_S, _OFF_S = (4.0, 25.0), (2.0, 10.0)


@dataclass(frozen=True)
class Switches:
    """One for each of L lamps: on for a time, out for a time, again and again.

    Attributes:
        on_s, off_s: (L,) s, how long.
        since_s: (L,) s, how long it has been on, or on and out, at time 0.
    """

    on_s: Floats
    off_s: Floats
    since_s: Floats

    @staticmethod
    def of(lamps: int, rng: np.random.Generator) -> "Switches":
        """For so many lamps, all on at time 0."""
        on_s, off_s = rng.uniform(*_ON_S, lamps), rng.uniform(*_OFF_S, lamps)
        return Switches(on_s, off_s, on_s * rng.uniform(size=lamps))

    def on(self, t_s: float) -> Mask:
        """(L,), which lamps are on at a time."""
        lit: Mask = (t_s + self.since_s) % (self.on_s + self.off_s) < self.on_s
        return lit

"""A smooth random field over directions that changes with time: fog banks."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Vectors


@dataclass(frozen=True)
class Field:
    """A sum of plane waves: mean 0, variance 1, the same from everywhere one looks.

    Attributes:
        wave: (K, 3) rad of phase per unit of direction.
        rate: (K,) rad/s.
        phase: (K,) rad.
    """

    wave: Vectors
    rate: Floats
    phase: Floats

    @staticmethod
    def of(rng: np.random.Generator, waves: int, detail: float, rate: float) -> "Field":
        """`waves` waves, `detail` rad of phase per rad of direction, changing with `rate` rad/s (both sd)."""
        return Field(
            detail * rng.standard_normal((waves, 3)),
            rate * rng.standard_normal(waves),
            rng.uniform(0.0, 2.0 * np.pi, waves),
        )

    def at(self, directions: Vectors, t_s: float) -> Floats:
        """(...,) values at unit directions (..., 3)."""
        phase = directions @ self.wave.T + (self.rate * t_s + self.phase)
        values: Floats = np.sqrt(2.0 / len(self.rate)) * np.cos(phase).sum(axis=-1)
        return values

"""How well features are seen, clean or degraded."""

import math
from dataclasses import dataclass

from sim.degrade.effects import effect
from sim.degrade.schedule import Schedule
from sim.errors import ConfigError


@dataclass(frozen=True)
class Seeing:
    """How well features are seen."""

    pixel_noise: float = 1.0  # px, sd per axis
    max_features: int = 150  # in one image
    track_life_s: float = 3.0  # mean time until a visible feature is lost by chance
    outliers: float = 0.0  # share of features that are mismatched
    moving: float = 0.0  # share of features that sit on moving objects

    def __post_init__(self) -> None:
        if self.pixel_noise < 0.0 or self.track_life_s <= 0.0 or self.max_features < 1:
            raise ConfigError(f"noise must not be negative, life and features must be above zero: {self}")
        if not (0.0 <= self.outliers <= 1.0 and 0.0 <= self.moving <= 1.0):
            raise ConfigError(f"outliers and moving are shares from 0 to 1: {self}")

    def degraded(self, schedule: Schedule, t_s: float) -> "Seeing | None":
        """How it is at a time from the first frame; None in a blackout."""
        kinds = dict.fromkeys(d.kind for d in schedule.degradations)
        effects = [effect(kind, schedule.severity(kind, t_s)) for kind in kinds]
        features = math.prod(e.features for e in effects)
        if features == 0.0:
            return None
        return Seeing(
            self.pixel_noise * math.prod(e.noise for e in effects),
            max(1, round(self.max_features * features)),
            self.track_life_s * math.prod(e.life for e in effects),
            1.0 - (1.0 - self.outliers) * math.prod(1.0 - e.outliers for e in effects),
            1.0 - (1.0 - self.moving) * math.prod(1.0 - e.moving for e in effects),
        )

"""What each degradation does to feature tracks: what points mode takes in place of images."""

from dataclasses import dataclass

from sim.degrade.schedule import STREAM


@dataclass(frozen=True)
class Effect:
    """Factors relative to clean images, and shares of tracks that are wrong."""

    features: float = 1.0  # on the number of features
    life: float = 1.0  # on the time until a feature is lost
    noise: float = 1.0  # on the pixel noise
    outliers: float = 0.0  # share of tracks that follow nothing real
    moving: float = 0.0  # share of tracks on things that move


_CLEAN = Effect()

# What KLT does on rendered images of these severities, measured against the true flow, by severity 1..5.
EFFECTS: dict[str, tuple[Effect, ...]] = {
    "blackout": (Effect(features=0.0),) * 5,
    "low_light": (
        Effect(1.0, 0.9, 1.8),
        Effect(0.95, 0.2, 3.5),
        Effect(0.75, 0.055, 5.0),
        Effect(0.5, 0.022, 6.0),
        Effect(0.2, 0.01, 7.0),
    ),
    "motion_blur": (
        Effect(1.0, 1.0, 1.1),
        Effect(0.98, 1.0, 1.2),
        Effect(0.97, 1.0, 1.5),
        Effect(0.94, 1.0, 1.9),
        Effect(0.9, 1.0, 2.2),
    ),
}
"""By kind, then by severity from 1."""


def effect(kind: str, severity: int) -> Effect:
    """What a kind does at a severity; 0 is clean. Kinds that act on frames and stamps leave tracks alone."""
    return _CLEAN if severity == 0 or kind in STREAM else EFFECTS[kind][severity - 1]

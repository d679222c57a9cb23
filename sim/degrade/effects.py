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

# What KLT does at these severities, from docs/severities.md: of features and of wrong steps the mean over the rendered
# flight and the real images, of life the geometric mean (a rendered life counts as .02 at least), and the noise of the
# real images, whose clean tracks are not as exact as rendered ones (never less than that of clean ones).
EFFECTS: dict[str, tuple[Effect, ...]] = {
    "blackout": (Effect(features=0.0),) * 5,
    "motion_blur": (
        Effect(1.00, 0.97, 1.00),
        Effect(1.00, 0.97, 1.04),
        Effect(1.00, 0.94, 1.09, outliers=0.01),
        Effect(1.00, 0.87, 1.19, outliers=0.01),
        Effect(1.00, 0.72, 1.35, outliers=0.02),
    ),
    "texture_loss": (
        Effect(1.00, 0.89, 1.13, outliers=0.01),
        Effect(1.00, 0.69, 1.38, outliers=0.02),
        Effect(0.99, 0.40, 1.71, outliers=0.05),
        Effect(0.92, 0.23, 2.06, outliers=0.11),
        Effect(0.73, 0.12, 2.46, outliers=0.21),
    ),
    "light_switch": (
        Effect(1.00, 0.96, 1.02),
        Effect(1.00, 0.88, 1.02),
        Effect(1.00, 0.66, 1.05),
        Effect(1.00, 0.41, 1.10),
        Effect(1.00, 0.11, 1.20, outliers=0.01),
    ),
    "moving_objects": (
        Effect(1.00, 0.56, 1.03, moving=0.03),
        Effect(1.00, 0.47, 1.08, moving=0.06),
        Effect(1.00, 0.38, 1.07, moving=0.12),
        Effect(1.00, 0.23, 1.17, moving=0.29),
        Effect(1.00, 0.11, 2.64, moving=0.85),
    ),
    "fog": (
        Effect(1.00, 0.97, 1.05),
        Effect(1.00, 0.91, 1.09, outliers=0.01),
        Effect(0.92, 0.69, 1.17, outliers=0.01),
        Effect(0.66, 0.56, 1.29, outliers=0.01),
        Effect(0.40, 0.08, 1.85, outliers=0.08),
    ),
    "lens_dirt": (
        Effect(1.00, 0.75, 1.08, outliers=0.01),
        Effect(1.00, 0.55, 1.14, outliers=0.01),
        Effect(1.00, 0.27, 1.26, outliers=0.03),
        Effect(1.00, 0.21, 1.32, outliers=0.05),
        Effect(0.90, 0.12, 1.74, outliers=0.17),
    ),
    "low_light": (
        Effect(1.00, 0.82, 1.25, outliers=0.01),
        Effect(1.00, 0.68, 1.35, outliers=0.01),
        Effect(1.00, 0.55, 1.42, outliers=0.01),
        Effect(1.00, 0.40, 1.61, outliers=0.02),
        Effect(1.00, 0.27, 1.98, outliers=0.05),
    ),
    "overexposure": (
        Effect(1.00, 0.87, 1.00),
        Effect(1.00, 0.87, 1.00),
        Effect(0.76, 0.67, 1.00),
        Effect(0.57, 0.46, 1.00),
        Effect(0.26, 0.07, 1.00),
    ),
    "auto_exposure": (
        Effect(1.00, 0.93, 1.02),
        Effect(1.00, 0.79, 1.05),
        Effect(1.00, 0.54, 1.08),
        Effect(0.99, 0.36, 1.05),
        Effect(0.93, 0.19, 1.09, outliers=0.01),
    ),
    "jpeg": (
        Effect(1.00, 0.89, 1.13),
        Effect(1.00, 0.75, 1.35, outliers=0.01),
        Effect(1.00, 0.42, 1.65, outliers=0.03),
        Effect(1.00, 0.15, 2.00, outliers=0.15),
        Effect(0.74, 0.07, 2.60, outliers=0.37),
    ),
}
"""By kind, then by severity from 1."""


def effect(kind: str, severity: int) -> Effect:
    """What a kind does at a severity; 0 is clean. Kinds that act on frames and stamps leave tracks alone."""
    return _CLEAN if severity == 0 or kind in STREAM else EFFECTS[kind][severity - 1]

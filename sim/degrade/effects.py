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
        Effect(1.00, 0.97, 1.01),
        Effect(1.00, 0.97, 1.03),
        Effect(1.00, 0.95, 1.10, outliers=0.01),
        Effect(1.00, 0.86, 1.19, outliers=0.01),
        Effect(1.00, 0.73, 1.36, outliers=0.02),
    ),
    "texture_loss": (
        Effect(1.00, 0.88, 1.13, outliers=0.01),
        Effect(1.00, 0.68, 1.36, outliers=0.02),
        Effect(0.99, 0.40, 1.71, outliers=0.04),
        Effect(0.92, 0.23, 2.08, outliers=0.11),
        Effect(0.73, 0.12, 2.50, outliers=0.20),
    ),
    "light_switch": (
        Effect(1.00, 0.98, 1.00),
        Effect(1.00, 0.89, 1.02),
        Effect(1.00, 0.67, 1.05),
        Effect(1.00, 0.41, 1.09),
        Effect(1.00, 0.11, 1.17, outliers=0.01),
    ),
    "moving_objects": (
        Effect(1.00, 0.58, 1.02, moving=0.03),
        Effect(1.00, 0.46, 1.06, moving=0.07),
        Effect(1.00, 0.38, 1.07, moving=0.11),
        Effect(1.00, 0.23, 1.14, moving=0.29),
        Effect(1.00, 0.11, 2.56, moving=0.85),
    ),
    "fog": (
        Effect(1.00, 0.97, 1.04),
        Effect(1.00, 0.92, 1.08),
        Effect(0.92, 0.69, 1.15, outliers=0.01),
        Effect(0.66, 0.56, 1.29, outliers=0.01),
        Effect(0.40, 0.08, 1.89, outliers=0.09),
    ),
    "lens_dirt": (
        Effect(1.00, 0.74, 1.09, outliers=0.01),
        Effect(1.00, 0.53, 1.13, outliers=0.01),
        Effect(1.00, 0.27, 1.26, outliers=0.03),
        Effect(1.00, 0.21, 1.34, outliers=0.05),
        Effect(0.89, 0.12, 1.69, outliers=0.17),
    ),
    "low_light": (
        Effect(1.00, 0.86, 1.24, outliers=0.01),
        Effect(1.00, 0.70, 1.31, outliers=0.01),
        Effect(1.00, 0.55, 1.40, outliers=0.01),
        Effect(1.00, 0.40, 1.57, outliers=0.03),
        Effect(1.00, 0.14, 1.98, outliers=0.05),
    ),
    "overexposure": (
        Effect(1.00, 0.90, 1.00),
        Effect(1.00, 0.86, 1.00),
        Effect(0.76, 0.67, 1.00),
        Effect(0.57, 0.46, 1.00),
        Effect(0.26, 0.07, 1.00),
    ),
    "auto_exposure": (
        Effect(1.00, 0.95, 1.01),
        Effect(1.00, 0.79, 1.04),
        Effect(1.00, 0.56, 1.04),
        Effect(0.99, 0.34, 1.05),
        Effect(0.78, 0.18, 1.02),
    ),
    "jpeg": (
        Effect(1.00, 0.89, 1.13),
        Effect(1.00, 0.74, 1.35, outliers=0.01),
        Effect(1.00, 0.41, 1.65, outliers=0.03),
        Effect(1.00, 0.15, 2.00, outliers=0.15),
        Effect(0.74, 0.07, 2.60, outliers=0.38),
    ),
}
"""By kind, then by severity from 1."""


def effect(kind: str, severity: int) -> Effect:
    """What a kind does at a severity; 0 is clean. Kinds that act on frames and stamps leave tracks alone."""
    return _CLEAN if severity == 0 or kind in STREAM else EFFECTS[kind][severity - 1]

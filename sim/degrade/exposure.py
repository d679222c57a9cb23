"""Too little light, too much, and a camera that follows it late: what the sensor gets, and its gain."""

from dataclasses import dataclass

import numpy as np

from sim.camera.sensor import MAX_GAIN
from sim.degrade.schedule import Degradation
from sim.degrade.switching import switch_times
from sim.degrade.view import View

LOW_LIGHT = (0.08, 0.035, 0.022, 0.012, 0.005)
"""Light that reaches the sensor by severity, as a share of that of a clean image; gain makes up for it to its end."""
OVEREXPOSURE = (1.35, 3.2, 4.2, 5.0, 8.0)
"""Light by severity, as a multiple of that of a clean image, at gain 1."""


@dataclass(frozen=True)
class Following:
    """A scene whose light steps up and down, and a camera that follows.

    Attributes:
        stops: size of a step, in powers of two.
        lag_s: time constant of the camera, in which it makes up for 63 % of what is left, in stops.
        dwell_s: mean time between two steps.
    """

    stops: float
    lag_s: float
    dwell_s: float


AUTO_EXPOSURE = (
    Following(0.4, 0.10, 4.0),
    Following(1.0, 0.25, 3.0),
    Following(1.6, 0.50, 2.0),
    Following(2.5, 1.00, 1.3),
    Following(4.0, 2.00, 0.7),
)
"""By severity."""
_MIN_EXPOSURE = 1.0 / 64.0  # the shortest, relative to that of a clean image


@dataclass(frozen=True)
class Exposure:
    """What becomes of the light.

    Attributes:
        light: factor on what the sensor gets.
        gain: factor on its electrons, at most `MAX_GAIN`.
    """

    light: float = 1.0
    gain: float = 1.0

    def and_then(self, other: "Exposure") -> "Exposure":
        """Both at once."""
        return Exposure(self.light * other.light, min(self.gain * other.gain, MAX_GAIN))


COVERED = Exposure(0.0, MAX_GAIN)
"""A covered lens: no light, and all the gain there is."""


def low_light(severity: int) -> Exposure:
    """Little light, and the gain that brings the image back to its brightness as far as it reaches."""
    light = LOW_LIGHT[severity - 1]
    return Exposure(light, min(1.0 / light, MAX_GAIN))


def overexposure(severity: int) -> Exposure:
    """Too long an exposure, as of a camera whose setting is stuck."""
    return Exposure(OVEREXPOSURE[severity - 1])


def auto_exposure(view: View, degradation: Degradation) -> Exposure:
    """Light that steps, and an exposure that follows with a lag: shorter in bright light, gain in the dark.

    From one step of light to the next the exposure E goes like `d ln E / dt = (ln(1/light) - ln E) / lag`, so it
    is known at any time without the frames before.
    """
    following = AUTO_EXPOSURE[degradation.severity - 1]
    light, exposure = 0.0, 0.0  # in stops
    times, levels = _steps(view, degradation, following)
    for k, start_s in enumerate(times):
        if start_s > view.t_s:
            break
        light = levels[k]
        end_s = min(view.t_s, times[k + 1] if k + 1 < len(times) else np.inf)
        wanted = min(max(-light, np.log2(_MIN_EXPOSURE)), np.log2(MAX_GAIN))
        exposure = wanted + (exposure - wanted) * float(np.exp(-(end_s - start_s) / following.lag_s))
    return Exposure(2.0 ** (light + min(exposure, 0.0)), 2.0 ** max(exposure, 0.0))


def _steps(view: View, degradation: Degradation, following: Following) -> tuple[list[float], list[float]]:
    """When light steps [s], and what it is from then on [stops]: away from normal, up or down, and back."""
    rng = view.generator("auto_exposure")
    away = following.stops * float(rng.choice([-1.0, 1.0]))
    times = switch_times(rng, degradation, following.dwell_s)
    return times.tolist(), [away if k % 2 == 0 else 0.0 for k in range(len(times))]

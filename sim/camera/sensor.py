"""From light to grey values: an image sensor with shot and read noise, gain, and a response curve."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.arrays import Image
from sim.errors import ConfigError
from sim.radiance import LINEAR_MAX, RESPONSE_GAMMA

Plane = NDArray[np.float32]
"""(height, width) of light or of variance."""

FULL_WELL = 9000.0
"""Electrons that saturate a pixel at gain 1."""
MAX_GAIN = 24.0
"""Where the gain ends that makes up for missing light."""

_READ_NOISE = 5.0  # electrons, sd
_PATTERN_NOISE = 1.5  # electrons, sd between pixels, the same in every frame
_CURVE = np.rint(255.0 * (np.arange(4096) / 4095.0) ** (1.0 / RESPONSE_GAMMA)).astype(np.uint8)


def noise_variance(linear: Plane) -> Plane:
    """Variance [electrons^2] of shot and read noise in an image of this linear radiance, taken at light 1."""
    variance: Plane = linear * np.float32(FULL_WELL / LINEAR_MAX)
    variance += np.float32(_READ_NOISE**2)
    return variance


@dataclass(frozen=True)
class ImageSensor:
    """One sensor with its fixed pattern.

    Attributes:
        pattern: (height, width) electrons that each pixel reads too much.
    """

    pattern: Plane

    @staticmethod
    def of(width: int, height: int, rng: np.random.Generator) -> "ImageSensor":
        """A sensor of `width` x `height` px."""
        pattern = _PATTERN_NOISE * rng.standard_normal((height, width), dtype=np.float32)
        pattern.setflags(write=False)
        return ImageSensor(pattern)

    def develop(
        self,
        linear: Image | Plane,
        light: float,
        rng: np.random.Generator,
        gain: float | None = None,
        held: Plane | None = None,
    ) -> Image:
        """The grey image (height, width) uint8 of linear radiance (height, width), 0 to `LINEAR_MAX`, under a share
        of light.

        Electrons arrive with shot noise (normal, of the Poisson's variance) and are read with read noise; gain and
        the response curve come last. That is the EMVA 1288 model (release 4.0, section 2) with a gamma in place of
        its linear response. Radiance that was decoded from an image holds noise already: only what is missing is
        added. (A share p of Poisson arrivals of mean m is Poisson of mean p m; scaling the arrivals leaves variance
        p^2 m of the p m that it should have.)

        Args:
            linear: as `sim.radiance.decode` gives it.
            light: factor on the radiance; above 1 it overexposes.
            rng: draws the noise.
            gain: factor on the electrons; None brings the image back to its normal brightness, as far as
                `MAX_GAIN` reaches.
            held: (height, width) variance [electrons^2] that `linear` holds already, at light 1; None for none.

        Raises:
            ConfigError: `light` or `gain` is negative.
        """
        if not light >= 0.0 or (gain is not None and not gain >= 0.0):
            raise ConfigError(f"light is {light} and gain {gain}, expected 0 or more")
        if gain is None:
            gain = min(1.0 / light, MAX_GAIN) if light > 0.0 else MAX_GAIN
        electrons = linear.astype(np.float32)
        electrons *= np.float32(light * FULL_WELL / LINEAR_MAX)
        variance = electrons + np.float32(_READ_NOISE**2)
        if held is not None:
            variance -= held * np.float32(light * light)
            np.maximum(variance, 0.0, out=variance)
        noise = rng.standard_normal(electrons.shape, dtype=np.float32)
        noise *= cv2.sqrt(variance)
        electrons += noise
        electrons += self.pattern
        electrons *= np.float32(gain * 4095.0 / FULL_WELL)
        np.clip(electrons, 0.0, 4095.0, out=electrons)
        grey: Image = _CURVE[electrons.astype(np.uint16)]
        return grey

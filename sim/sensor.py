"""From light to grey values: an image sensor with shot and read noise, gain, and a response curve."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.arrays import Image
from sim.camera import LINEAR_MAX
from sim.errors import ConfigError
from sim.scene import RESPONSE_GAMMA
from sim.schedule import MAX_SEVERITY

FULL_WELL = 9000.0
"""Electrons that saturate a pixel at gain 1."""

_READ_NOISE = 5.0  # electrons, sd
_PATTERN_NOISE = 1.5  # electrons, sd between pixels, the same in every frame
_MAX_GAIN = 24.0
_CURVE = np.rint(255.0 * (np.arange(4096) / 4095.0) ** (1.0 / RESPONSE_GAMMA)).astype(np.uint8)

LIGHT = (1.0, 0.05, 0.012, 0.005, 0.0025, 0.0012)
"""Light that reaches the sensor by severity of low_light, as a share of that of a clean image."""


@dataclass(frozen=True)
class ImageSensor:
    """One sensor with its fixed pattern.

    Attributes:
        pattern: (height, width) electrons that each pixel reads too much.
    """

    pattern: NDArray[np.float32]

    @staticmethod
    def of(width: int, height: int, rng: np.random.Generator) -> "ImageSensor":
        """A sensor of `width` x `height` px."""
        pattern = _PATTERN_NOISE * rng.standard_normal((height, width), dtype=np.float32)
        pattern.setflags(write=False)
        return ImageSensor(pattern)

    def develop(self, linear: Image, light: float, rng: np.random.Generator) -> Image:
        """The grey image (height, width) uint8 of linear radiance (height, width) uint16 under a share of
        light.

        Electrons arrive with shot noise (normal, of the Poisson's variance) and are read with read noise;
        gain brings the image back to its normal brightness as far as it reaches; the response curve comes
        last. That is the EMVA 1288 model (release 4.0, section 2) with a gamma in place of its linear
        response.

        Raises:
            ConfigError: `light` is not within 0 and 1.
        """
        if not 0.0 <= light <= 1.0:
            raise ConfigError(f"light is {light}, expected from 0 to 1")
        gain = min(1.0 / light, _MAX_GAIN) if light > 0.0 else _MAX_GAIN
        electrons = linear.astype(np.float32)
        electrons *= np.float32(light * FULL_WELL / LINEAR_MAX)
        noise = rng.standard_normal(electrons.shape, dtype=np.float32)
        noise *= cv2.sqrt(electrons + np.float32(_READ_NOISE**2))
        electrons += noise
        electrons += self.pattern
        electrons *= np.float32(gain * 4095.0 / FULL_WELL)
        np.clip(electrons, 0.0, 4095.0, out=electrons)
        grey: Image = _CURVE[electrons.astype(np.uint16)]
        return grey


def light_at(severity: int, dark: bool) -> float:
    """The share of light in a low light of a severity from 0 to 5, or with the lens covered."""
    if not 0 <= severity <= MAX_SEVERITY:
        raise ConfigError(f"severity of low_light is {severity}, expected 0 to {MAX_SEVERITY}")
    return 0.0 if dark else LIGHT[severity]

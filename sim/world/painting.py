"""A texture in the light that falls on it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.arrays import Floats, Image, Mask
from sim.radiance import RESPONSE_GAMMA
from sim.world.lighting import irradiance
from sim.world.texture import Albedo

_MEAN_RADIANCE = 0.28  # of what saturates the camera
_MEAN_ALBEDO = 0.5


@dataclass(frozen=True)
class Painting:
    """What a surface is painted with, and the light of each lamp on it.

    Attributes:
        albedo: (height, width) uint16, of 65535.
        light: (L, rows, columns) of each lamp alone, as `irradiance` takes it, coarser than the albedo; None for
            a surface that shines by itself, whose albedo is its radiance.
    """

    albedo: NDArray[np.uint16]
    light: Floats | None

    @staticmethod
    def of(albedo: Albedo, light: Floats | None) -> "Painting":
        """With an albedo (height, width) in 0..1."""
        return Painting(np.rint(albedo * np.float32(65535.0)).astype(np.uint16), light)

    def texture(self, on: Mask) -> Image:
        """(height, width, 3) uint8, encoded radiance with those lamps on (L,)."""
        radiance = self.albedo.astype(np.float32)
        radiance *= np.float32(1.0 / 65535.0)
        if self.light is not None:
            light = irradiance(self.light, on).astype(np.float32) * np.float32(_MEAN_RADIANCE / _MEAN_ALBEDO)
            height, width = radiance.shape
            radiance *= cv2.resize(light, (width, height), interpolation=cv2.INTER_LINEAR)
        cv2.min(radiance, 1.0, dst=radiance)
        encoded = cv2.convertScaleAbs(cv2.pow(radiance, 1.0 / RESPONSE_GAMMA), alpha=255.0)
        return np.asarray(cv2.cvtColor(encoded, cv2.COLOR_GRAY2RGB))

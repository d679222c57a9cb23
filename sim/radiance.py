"""Grey values and the light behind them: one response curve for textures, renderings and recordings."""

import cv2
import numpy as np

from navcore.arrays import Image

RESPONSE_GAMMA = 2.2
"""Grey values are radiance to the power of 1/2.2."""
LINEAR_MAX = 65535
"""Radiance that saturates the camera, as a number in a linear image."""

_DECODE = np.rint(LINEAR_MAX * (np.arange(256) / 255.0) ** RESPONSE_GAMMA).astype(np.uint16)


def decode(grey: Image) -> Image:
    """Linear radiance (height, width) uint16 of grey values (height, width) uint8."""
    return np.asarray(cv2.LUT(grey, _DECODE))

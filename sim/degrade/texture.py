"""Loss of texture: surfaces are flattened, their outlines stay, as if walls had been painted over.

The base is the image filtered by itself: He, Sun, Tang, "Guided image filtering", TPAMI 2013, eqs. (5), (6), (8).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sim.camera.sensor import Plane
from sim.degrade.view import Light
from sim.radiance import LINEAR_MAX


@dataclass(frozen=True)
class TextureLoss:
    """One severity.

    Attributes:
        lost: share of the detail that is taken away.
        edge: contrast below which something counts as detail, in square roots of radiance, 0 to 1.
    """

    lost: float
    edge: float


TEXTURE_LOSS = (
    TextureLoss(0.5, 0.10),
    TextureLoss(0.75, 0.20),
    TextureLoss(0.9, 0.30),
    TextureLoss(0.96, 0.5),
    TextureLoss(0.99, 1.0),
)
"""By severity."""
_RADIUS = 10  # px
_BRIGHT = float(np.sqrt(LINEAR_MAX))


def texture_loss(light: Light, severity: int) -> None:
    """Take detail away; the noise that is in it goes too."""
    wanted = TEXTURE_LOSS[severity - 1]
    root = np.asarray(cv2.sqrt(light.linear), dtype=np.float32)
    base = _smoothed(root, (wanted.edge * _BRIGHT) ** 2)
    flat = base + np.float32(1.0 - wanted.lost) * (root - base)
    np.maximum(flat, 0.0, out=flat)
    light.linear = flat * flat
    light.held *= np.float32((1.0 - wanted.lost) ** 2)


def _smoothed(image: Plane, edge2: float) -> Plane:
    mean = _box(image)
    variance = _box(image * image) - mean * mean
    a = variance / (variance + np.float32(edge2))
    b = mean - a * mean
    smoothed: Plane = _box(a) * image + _box(b)
    return smoothed


def _box(image: NDArray[np.floating]) -> Plane:
    side = 2 * _RADIUS + 1
    return np.asarray(cv2.blur(image, (side, side), borderType=cv2.BORDER_REFLECT_101), dtype=np.float32)

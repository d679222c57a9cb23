"""Brightness that changes from image to image, and how images are brought to the same one."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from navcore.arrays import Floats, Image, Pixels
from navcore.tracker.config import TrackerConfig
from navcore.tracker.quality import ImageQuality

_SCALE = 4  # px of the half-size image in one of its thumbnail
_CLIP = 40.0  # grey values, a larger change is a wrong guess of where the feature is


@dataclass(frozen=True)
class Exposed:
    """An image, how bright it is and what contrast it has.

    Attributes:
        image: (height, width).
        mean: grey value.
        gain: factor that brings its contrast to the usual one.
        half: (height / 2, width / 2).
        thumbnail: (height / 8, width / 8) means.
    """

    image: Image
    mean: float
    gain: float
    half: Image
    thumbnail: Image

    @staticmethod
    def of(image: Image, quality: ImageQuality, config: TrackerConfig) -> "Exposed":
        """An image of known quality."""
        half = np.asarray(cv2.pyrDown(image), dtype=np.uint8)
        h, w = half.shape
        small = cv2.resize(half, (max(1, w // _SCALE), max(1, h // _SCALE)), interpolation=cv2.INTER_AREA)
        gain = min(config.contrast / max(quality.contrast, 1e-6), config.max_gain)
        return Exposed(image, quality.mean, gain, half, np.asarray(small, dtype=np.uint8))

    @cached_property
    def normalised(self) -> Image:
        """The image with mean 128 and the usual contrast."""
        table = np.clip(np.round(128.0 + self.gain * (np.arange(256.0) - self.mean)), 0.0, 255.0)
        return np.asarray(cv2.LUT(self.image, table.astype(np.uint8)), dtype=np.uint8)

    def around(self, uv: Pixels) -> Floats:
        """(N,) mean grey values around pixels (N, 2)."""
        h, w = self.thumbnail.shape
        at = np.clip((uv / (2 * _SCALE)).astype(int), 0, [w - 1, h - 1])
        return np.asarray(self.thumbnail[at[:, 1], at[:, 0]], dtype=np.float64)


def brightness_change(before: Exposed, uv_before: Pixels, now: Exposed, uv: Pixels) -> float:
    """Mean change of grey values around features (N, 2) that are about there in both images."""
    if len(uv) == 0:
        return 0.0
    return float(np.clip(now.around(uv) - before.around(uv_before), -_CLIP, _CLIP).mean())

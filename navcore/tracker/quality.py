"""What an image can offer, before it is tracked."""

from dataclasses import dataclass

import cv2
import numpy as np

from navcore.arrays import Image

_STRIDE = 4  # px between those that are looked at
_UPPER_END = 250  # grey value


@dataclass(frozen=True)
class ImageQuality:
    """What an image can offer.

    Attributes:
        mean: grey value 0..255.
        contrast: standard deviation of grey values.
        saturated: share of pixels at the upper end.
    """

    mean: float
    contrast: float
    saturated: float

    @staticmethod
    def of(image: Image) -> "ImageQuality":
        """Of an image (height, width)."""
        some = np.ascontiguousarray(image[::_STRIDE, ::_STRIDE])
        mean, contrast = (float(x[0, 0]) for x in cv2.meanStdDev(some))
        return ImageQuality(mean, contrast, float(np.count_nonzero(some >= _UPPER_END) / some.size))

    @property
    def fault(self) -> str | None:
        """What is wrong with the image, in a word or two, or None."""
        if self._dark:
            return "image dark"
        if self.saturated > 0.6:
            return "image saturated"
        return "image without texture" if self._flat else None

    @property
    def useless(self) -> bool:
        """Whether nothing can be followed into the image; any other fault is a remark."""
        return self._dark or self._flat

    @property
    def _dark(self) -> bool:
        return self.mean < 12.0 and self.contrast < 6.0

    @property
    def _flat(self) -> bool:
        return self.contrast < 4.0

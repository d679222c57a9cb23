"""What an image can offer, before it is tracked."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Image

_STRIDE = 4  # px between those that are looked at


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
        count = np.bincount(image[::_STRIDE, ::_STRIDE].ravel(), minlength=256)
        share = count / count.sum()
        grey = np.arange(256.0)
        mean = float(share @ grey)
        contrast = float(np.sqrt(share @ (grey - mean) ** 2))
        return ImageQuality(mean, contrast, float(share[250:].sum()))

    @property
    def fault(self) -> str | None:
        """What is wrong with the image, in a word or two, or None."""
        if self.mean < 12.0 and self.contrast < 6.0:
            return "image dark"
        if self.saturated > 0.6:
            return "image saturated"
        if self.contrast < 4.0:
            return "image without texture"
        return None

    @property
    def useless(self) -> bool:
        """Whether nothing can be followed into the image; any other fault is a remark."""
        return self.contrast < (6.0 if self.mean < 12.0 else 4.0)

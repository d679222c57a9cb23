"""Compression, as of a video link: JPEG, whose blocks stay where they are while the scene moves."""

import cv2
import numpy as np

from navcore.arrays import Image

JPEG_QUALITY = (40, 20, 10, 5, 2)
"""OpenCV's quality by severity."""


def jpeg(image: Image, severity: int) -> Image:
    """The image after it was compressed."""
    done, data = cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY[severity - 1]))
    assert done
    decoded = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    assert decoded is not None
    return np.asarray(decoded, dtype=np.uint8)

"""ROS's image messages as grey images."""

from typing import Any

import cv2
import numpy as np

from navcore.arrays import Image
from navcore.errors import DataError

ENCODINGS: dict[str, tuple[int, int, int | None]] = {
    "mono8": (1, 1, None),
    "8UC1": (1, 1, None),
    "mono16": (2, 1, None),
    "16UC1": (2, 1, None),
    "rgb8": (1, 3, cv2.COLOR_RGB2GRAY),
    "bgr8": (1, 3, cv2.COLOR_BGR2GRAY),
    "rgba8": (1, 4, cv2.COLOR_RGBA2GRAY),
    "bgra8": (1, 4, cv2.COLOR_BGRA2GRAY),
}
"""Encodings of sensor_msgs/Image that are read: bytes a channel, channels, OpenCV's conversion to grey."""


def grey(message: Any, where: str) -> Image:
    """(height, width) uint8 of a sensor_msgs/Image or CompressedImage; of 16 bits the upper 8, as from a file.

    Raises:
        DataError: another encoding, too few bytes, or data that cannot be decoded; `where` names the image.
    """
    if hasattr(message, "encoding"):
        return _raw(message, where)
    data = np.frombuffer(message.data, dtype=np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
    if image is None:
        raise DataError(f"{where}: corrupt image ({message.format}), cannot be decoded")
    return np.asarray(image, dtype=np.uint8)


def _raw(message: Any, where: str) -> Image:
    if message.encoding not in ENCODINGS:
        raise DataError(f"{where}: encoding {message.encoding!r} is not read; known are {', '.join(ENCODINGS)}")
    size, channels, conversion = ENCODINGS[message.encoding]
    height, width, used = message.height, message.width, message.width * size * channels
    data = np.frombuffer(message.data, dtype=np.uint8)
    if message.step < used or data.size != message.step * height:
        wanted = f"{height} rows of {message.step} bytes for {width}x{height} {message.encoding}"
        raise DataError(f"{where}: corrupt image, {data.size} bytes where {wanted} are expected")
    rows = data.reshape(height, message.step)[:, :used]
    if size == 2:
        upper = 0 if message.is_bigendian else 1
        return np.ascontiguousarray(rows[:, upper::2])
    if conversion is None:
        return np.ascontiguousarray(rows)
    return np.asarray(cv2.cvtColor(rows.reshape(height, width, channels), conversion), dtype=np.uint8)

"""Sample images of the rendered flight, small enough to stand in a page."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from eval.errors import EvalError
from eval.records import Record
from eval.sources import RenderedFlight
from navcore.errors import NavcoreError

_WIDTH = 376
_QUALITY = 80
_AT_S = (8.0, 22.0)
"""Seconds from the first frame; the degradations of the preset are on at the second one."""


@dataclass(frozen=True)
class Sample:
    """One picture of a condition.

    Attributes:
        condition: what was done to vision.
        t_s: seconds from the first frame.
        source: a `data:` address of the picture.
    """

    condition: str
    t_s: float
    source: str


def samples(records: Iterable[Record], workspace: Path) -> list[Sample]:
    """Two pictures of every rendered condition, as long as its recording is still in the study's folder."""
    found: dict[str, RenderedFlight] = {}
    for record in records:
        source = dict(record.config["source"])
        if source.pop("kind") == RenderedFlight.__name__:
            found.setdefault(str(record.config["condition"]), RenderedFlight(**source))
    result = []
    for condition, flight in found.items():
        try:
            frames = flight.load(workspace).frames
            for t_s in _AT_S:
                frame = min(frames, key=lambda f: abs((f.t_ns - frames[0].t_ns) * 1e-9 - t_s))
                result.append(Sample(condition, t_s, _address(frame.images[0].load())))
        except (EvalError, NavcoreError):
            continue
    return result


def _address(image: "np.typing.NDArray[np.uint8]") -> str:
    height = round(image.shape[0] * _WIDTH / image.shape[1])
    small = cv2.resize(image, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()

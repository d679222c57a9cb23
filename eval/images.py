"""Sample images of recordings with images, small enough to stand in a page."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from eval.cells import Source
from eval.errors import EvalError
from eval.flights import RenderedFlight
from eval.records import Record
from eval.sources import Degraded, Recording, degradations, restored
from navcore.errors import NavcoreError
from sim.errors import SimError

_WIDTH = 376
_QUALITY = 80
_WITH_IMAGES = tuple(kind.__name__ for kind in (RenderedFlight, Degraded, Recording))


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
    """A picture of every platform and condition with images, as long as its recording can still be had."""
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for record in records:
        names = tuple(str(record.config[name]) for name in ("platform", "regime", "condition"))
        if record.config["source"]["kind"] in _WITH_IMAGES:
            found.setdefault((names[0], names[1], names[2]), record.config["source"])
    sources = {names: restored(content) for names, content in found.items()}
    middles: dict[tuple[str, str], float] = {}  # so that a clean picture is of the same moment
    for (platform, regime, _), source in sources.items():
        for d in degradations(source)[:1]:
            middles.setdefault((platform, regime), 0.5 * (d.start_s + d.end_s))
    result, shown = [], set()
    for (platform, regime, condition), source in sources.items():
        if source in shown:
            continue
        shown.add(source)
        try:
            sample = _sample(f"{platform}, {regime}, {condition}", source, middles.get((platform, regime)), workspace)
        except (EvalError, NavcoreError, SimError):
            continue
        result += [sample] if sample is not None else []
    return result


def _sample(title: str, source: Source, otherwise_s: float | None, workspace: Path) -> Sample | None:
    """A picture in the middle of the first degradation, or else at that time or of it all; None without images."""
    frames = [f for f in source.load(workspace).frames if 0 in f.images]
    if not frames:
        return None
    first_ns = frames[0].t_ns
    spans = degradations(source)
    if spans:
        at_s = 0.5 * (spans[0].start_s + spans[0].end_s)
    else:
        at_s = otherwise_s if otherwise_s is not None else 0.5e-9 * (frames[-1].t_ns - first_ns)
    frame = min(frames, key=lambda f: abs((f.t_ns - first_ns) * 1e-9 - at_s))
    return Sample(title, (frame.t_ns - first_ns) * 1e-9, _address(frame.images[0].load()))


def _address(image: "np.typing.NDArray[np.uint8]") -> str:
    height = round(image.shape[0] * _WIDTH / image.shape[1])
    small = cv2.resize(image, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode()

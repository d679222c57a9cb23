"""Patches of one image found in another: pyramidal Lucas-Kanade."""

import cv2
import numpy as np

from navcore.arrays import Image, Mask, Pixels
from navcore.tracker.config import TrackerConfig
from navcore.tracker.exposure import Exposed

_STEPS, _STEP_PX = 20, 0.03  # iterations end after so many, or with a step so small
_MIN_EIGENVALUE = 1e-4  # of a patch, at the usual contrast


def flow(
    before: Exposed, now: Exposed, uv: Pixels, start: Pixels, config: TrackerConfig, *, changed: bool
) -> tuple[Pixels, Mask]:
    """Where the patches around `uv` (N, 2) of one image are in another.

    Args:
        before, now: the images.
        uv: px in `before`.
        start: (N, 2) px in `now` at which the search begins.
        config: settings.
        changed: whether brightness differs between the images.

    Returns:
        uv (N, 2), and which were found (N,).
    """
    if len(uv) == 0:
        return np.zeros((0, 2)), np.zeros(0, dtype=bool)
    if changed:
        return _lucas_kanade(before.normalised, now.normalised, uv, start, config, 1.0)
    return _lucas_kanade(before.image, now.image, uv, start, config, now.gain)


def flow_in_other_light(
    before: Exposed, now: Exposed, uv: Pixels, start: Pixels, config: TrackerConfig
) -> tuple[Pixels, Mask]:
    """The same where light has changed otherwise than by a gain, as when one of several lamps goes out.

    Both images are equalised locally, which costs as much as all the rest and follows patches less exactly.
    """
    clahe = cv2.createCLAHE(config.clahe_clip, (8, 8))
    first, second = (np.asarray(clahe.apply(exposed.image), dtype=np.uint8) for exposed in (before, now))
    return _lucas_kanade(first, second, uv, start, config, 1.0)


def _lucas_kanade(
    before: Image, now: Image, uv: Pixels, start: Pixels, config: TrackerConfig, gain: float
) -> tuple[Pixels, Mask]:
    found, status, error = cv2.calcOpticalFlowPyrLK(
        before,
        now,
        uv.astype(np.float32),
        start.astype(np.float32),
        winSize=(config.window, config.window),
        maxLevel=config.levels,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, _STEPS, _STEP_PX),
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        minEigThreshold=_MIN_EIGENVALUE / gain**2,
    )
    h, w = now.shape
    u, v, b = found[:, 0], found[:, 1], config.border - 0.5
    inside = (u >= b) & (v >= b) & (u < w - 1 - b) & (v < h - 1 - b)
    good = (status.ravel() == 1) & (error.ravel() < config.max_residual / gain) & inside
    return np.asarray(found, dtype=np.float64), np.asarray(good)

"""Dirt on the lens: smears and drops, far out of focus, that stay where they are in the image.

Where dirt covers the lens the scene is blurred, dimmed, and mixed with light that the dirt scatters.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from navcore.arrays import Floats
from sim.camera.sensor import Plane
from sim.degrade.view import Light, View
from sim.radiance import LINEAR_MAX


@dataclass(frozen=True)
class Dirt:
    """One severity.

    Attributes:
        spots: how many.
        opacity: share of a spot's light that did not come straight through it.
    """

    spots: int
    opacity: float


LENS_DIRT = (Dirt(5, 0.6), Dirt(14, 0.85), Dirt(28, 0.93), Dirt(60, 0.97), Dirt(130, 0.99))
"""By severity; a worse one has the spots of a better one, and more."""
_SHARPNESS = 0.012  # sd of a spot's edge, in widths of the image
_SPREAD = 0.035  # sd of the blur behind it, in widths of the image
_PASSED, _SCATTERED = 0.55, 0.06 * LINEAR_MAX  # share of light that comes through blurred; light that it adds
_SMALL = 4  # the mask is made this much smaller: it is smooth


def lens_dirt(view: View, light: Light, severity: int) -> None:
    """Look through the dirt."""
    height, width = light.linear.shape
    clear = _clear((view.seed, view.camera), severity, width, height)
    small = cv2.resize(light.linear, (width // _SMALL, height // _SMALL), interpolation=cv2.INTER_AREA)
    behind = cv2.GaussianBlur(small, (0, 0), _SPREAD * width / _SMALL)
    behind = cv2.resize(behind, (width, height), interpolation=cv2.INTER_LINEAR)
    light.attenuate(clear)
    behind *= np.float32(_PASSED)
    behind += np.float32(_SCATTERED)
    light.add(behind * (np.float32(1.0) - clear))


@lru_cache(maxsize=16)
def _clear(place: tuple[int, int], severity: int, width: int, height: int) -> Plane:
    """(height, width): the share of light that comes straight through, fixed by seed and camera."""
    dirt = LENS_DIRT[severity - 1]
    rng = np.random.default_rng((*place, 7))
    w, h = width // _SMALL, height // _SMALL
    clear = np.ones((h, w), dtype=np.float32)
    for _ in range(dirt.spots):
        centre, size = rng.uniform((0.0, 0.0), (w, h)), 0.03 * w * rng.uniform(0.4, 1.0) * (1.0 + rng.pareto(2.5))
        outline = _outline(rng, centre, min(size, 0.2 * w))
        spot = np.zeros_like(clear)
        cv2.fillPoly(spot, [np.rint(outline * 16.0).astype(np.int32)], 1.0, cv2.LINE_8, 4)
        clear *= np.float32(1.0) - np.float32(dirt.opacity) * spot
    clear = np.asarray(cv2.GaussianBlur(clear, (0, 0), _SHARPNESS * w), dtype=np.float32)
    full: Plane = np.asarray(cv2.resize(clear, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    full.setflags(write=False)
    return full


def _outline(rng: np.random.Generator, centre: Floats, size: float) -> Floats:
    """(32, 2): a drop, or a smear along one direction."""
    angle = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
    radius = np.full(32, size)
    for k in (2, 3, 5):
        radius *= 1.0 + 0.25 / k * rng.standard_normal() * np.cos(k * angle + rng.uniform(0.0, 2.0 * np.pi))
    along = rng.uniform(0.0, np.pi)
    stretch = 3.0 if rng.random() < 0.3 else 1.0
    x, y = stretch * radius * np.cos(angle), radius * np.sin(angle) / np.sqrt(stretch)
    c, s = np.cos(along), np.sin(along)
    outline: Floats = centre + np.stack([c * x - s * y, s * x + c * y], axis=1)
    return outline

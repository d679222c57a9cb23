"""Procedural textures: dead leaves, with corners at many scales; windows; clouds.

Lee, Mumford, Huang, "Occlusion models for natural images", IJCV 2001: opaque shapes with sizes drawn from a
cubic power law, thrown over each other, have the scale-invariant statistics of natural images.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from navcore.arrays import Floats, Image
from sim.world.look import Look
from sim.world.surface import Surface

Albedo = NDArray[np.float32]
"""(height, width) in 0..1."""

_SMALLEST_M, _SMALLEST_TEXELS = 0.03, 6.0
_SHADES = (15.0, 217.0)  # albedo in 1/255; OpenCV smooths outlines in 8 bits only
_GLASS, _FRAME = (25.0, 60.0), 200.0  # the same
_STOREY, _AXES, _WINDOW = 2.6, 1.9, (1.0, 1.3)  # m
_CLOUDS = ((5.0, 1.0), (2.0, 0.5), (0.8, 0.25))  # size [m] and strength


def paint(surface: Surface, ground: float, rng: np.random.Generator) -> Albedo:
    """Albedo (height, width) of a surface with shade `ground` [1/255] under its shapes."""
    look, (width, height) = surface.look, surface.texels
    if look.pattern == "sky":
        return _clouds(surface, ground, rng)
    image = dead_leaves(width, height, surface.texels_per_m, look, ground, rng)
    if look.pattern == "windows" and surface.upright:
        _set_windows(image, surface.texels_per_m, rng)
    noise = rng.standard_normal((height // 3 + 1, width // 3 + 1)).astype(np.float32)
    grain = cv2.resize(1.0 + look.grain * noise, (width, height))
    textured: Albedo = np.clip(image * (grain * np.float32(1.0 / 255.0)), 0.02, 0.95)
    return textured


def dead_leaves(
    width: int, height: int, texels_per_m: float, look: Look, ground: float, rng: np.random.Generator
) -> Image:
    """Shades (height, width) in 1/255: squares, triangles, discs and stripes over each other."""
    image = np.full((height, width), ground, dtype=np.uint8)
    smallest_m = min(max(_SMALLEST_M, _SMALLEST_TEXELS / texels_per_m), 0.5 * look.largest_m)
    density = look.leaves_per_m2 * (_SMALLEST_M / smallest_m) ** 2  # as many in the image, seen from further away
    area = width * height / texels_per_m**2
    n = round(density * area + 20.0 * min(1.0, look.leaves_per_m2 / 90.0))
    u = rng.random(n)
    a, b = smallest_m**-2.0, look.largest_m**-2.0
    sizes = (a - u * (a - b)) ** -0.5 * texels_per_m  # density ~ size^-3
    order = np.argsort(-sizes + rng.uniform(0.0, 0.3, n) * texels_per_m)  # small ones mostly on top
    centres = rng.uniform((0.0, 0.0), (width, height), (n, 2))
    shades = np.clip(ground + look.contrast * rng.standard_t(3.0, n), *_SHADES)
    angles, kinds = rng.uniform(0.0, np.pi, n), rng.integers(0, 4, n)
    for k in order:
        _draw(image, kinds[k], centres[k], sizes[k], angles[k], float(shades[k]))
    return image


def _draw(image: Image, kind: int, centre: Floats, size: float, angle: float, shade: float) -> None:
    if kind == 0:
        cv2.circle(image, np.rint(centre * 8.0).astype(int).tolist(), round(4.0 * size), shade, -1, cv2.LINE_AA, 3)
        return
    corners = {1: 4, 2: 3, 3: 4}[int(kind)]
    turns = angle + 2.0 * np.pi * np.arange(corners) / corners
    outline = 0.6 * size * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    if kind == 3:  # a stripe
        along = np.array([np.cos(angle), np.sin(angle)])
        outline = outline + np.outer(outline @ along, along) * 1.5
    points = np.rint((centre + outline) * 8.0).astype(np.int32)
    cv2.fillConvexPoly(image, points, shade, cv2.LINE_AA, 3)


def _set_windows(image: Image, texels_per_m: float, rng: np.random.Generator) -> None:
    """Rows of windows, from the ground up, in an image of a wall that stands on its last row."""
    height, width = image.shape
    axes = max(1, int(width / texels_per_m / _AXES))
    for storey in range(int(height / texels_per_m / _STOREY)):
        for axis in range(axes):
            middle = np.array([(axis + 0.5) / axes * width, height - (storey + 0.55) * _STOREY * texels_per_m])
            half = 0.5 * texels_per_m * np.array(_WINDOW)
            frame = 0.07 * texels_per_m
            _fill(image, middle - half - frame, middle + half + frame, _FRAME)
            for side in (-1.0, 1.0):
                pane = middle + np.array([0.5 * side * half[0], 0.0])
                reach = half * [0.5, 1.0] - 0.5 * frame
                _fill(image, pane - reach, pane + reach, rng.uniform(*_GLASS))


def _fill(image: Image, low: Floats, high: Floats, shade: float) -> None:
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    cv2.fillConvexPoly(image, np.rint(corners * 8.0).astype(np.int32), shade, cv2.LINE_AA, 3)


def _clouds(surface: Surface, ground: float, rng: np.random.Generator) -> Albedo:
    """Soft noise of a few sizes, which fades towards the edges: there the next surface goes on."""
    width, height = surface.texels
    metres = 2.0 * np.array(surface.half)
    noise = np.zeros((height, width), dtype=np.float32)
    for size, strength in _CLOUDS:
        columns, rows = (max(3, round(m / size)) for m in metres)
        knots = rng.standard_normal((rows, columns)).astype(np.float32)
        noise += np.float32(strength) * cv2.resize(knots, (width, height), interpolation=cv2.INTER_CUBIC)
    x, y = (np.minimum(1.0, 4.0 * np.minimum(t, 1.0 - t)) for t in ((np.arange(n) + 0.5) / n for n in (width, height)))
    fade = np.outer(y, x).astype(np.float32)
    shades = np.float32(ground) + np.float32(surface.look.contrast) * noise * fade
    radiance: Albedo = np.clip(shades / np.float32(255.0), 0.0, 1.0)
    return radiance

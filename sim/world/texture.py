"""Procedural textures with corners at many scales: dead leaves.

Lee, Mumford, Huang, "Occlusion models for natural images", IJCV 2001: opaque shapes with sizes drawn from a
cubic power law, thrown over each other, have the scale-invariant statistics of natural images.
"""

import cv2
import numpy as np

from navcore.arrays import Floats, Image

_SMALLEST_M, _LARGEST_M = 0.03, 1.2
_LEAVES_PER_M2 = 90
_SHADES = (15.0, 217.0)  # albedo in 1/255; OpenCV smooths outlines in 8 bits only
_GROUND = (80.0, 150.0)  # the same, of a surface under its leaves
_CONTRAST = 18.0  # 1/255, typical difference of a leaf from the ground; a few differ by much more


def dead_leaves(width: int, height: int, texels_per_m: float, rng: np.random.Generator) -> Floats:
    """Albedo (height, width) in 0..1: squares, triangles, discs and stripes over each other."""
    ground = rng.uniform(*_GROUND)
    image = np.full((height, width), ground, dtype=np.uint8)
    n = round(_LEAVES_PER_M2 * width * height / texels_per_m**2) + 20
    u = rng.random(n)
    a, b = _SMALLEST_M**-2.0, _LARGEST_M**-2.0
    sizes = (a - u * (a - b)) ** -0.5 * texels_per_m  # density ~ size^-3
    order = np.argsort(-sizes + rng.uniform(0.0, 0.3, n) * texels_per_m)  # small ones mostly on top
    centres = rng.uniform((0.0, 0.0), (width, height), (n, 2))
    shades = np.clip(ground + _CONTRAST * rng.standard_t(3.0, n), *_SHADES)
    angles, kinds = rng.uniform(0.0, np.pi, n), rng.integers(0, 4, n)
    for k in order:
        _draw(image, kinds[k], centres[k], sizes[k], angles[k], float(shades[k]))
    grain = cv2.resize(rng.standard_normal((height // 3 + 1, width // 3 + 1)).astype(np.float32), (width, height))
    textured: Floats = np.clip(image / 255.0 * (1.0 + 0.05 * grain), 0.02, 0.95)
    return textured


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

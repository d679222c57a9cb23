"""Which way the pixels of a lens look, and which of them see nothing."""

import numpy as np

from navcore.arrays import Pixels, Vectors
from navcore.camera import Camera

_SAME = 1e-3  # px


def rays_of(camera: Camera, uv: Pixels) -> Vectors:
    """Unit bearings (..., 3) in C of pixels (..., 2); nan where the lens sees nothing.

    Beyond the angle at which a distortion turns back no direction has such a pixel, and what inverts the model
    ends anywhere.
    """
    rays = camera.unproject(uv)
    met = np.abs(camera.project(rays) - uv).max(axis=-1) < _SAME
    seen: Vectors = np.where((met & camera.unfolded(rays))[..., None], rays, np.nan)
    return seen

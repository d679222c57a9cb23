"""Motion blur of images that were taken sharp: the rig's own turning while the shutter is open.

The gyro tells the turning; how the camera moves along would need the scene's distances and is left out.
"""

import cv2
import numpy as np

from navcore.arrays import Floats
from sim.camera.exposure import EXPOSURE_S, MAX_STEP_PX
from sim.camera.sensor import Plane
from sim.degrade.view import STEP, Coarse, Light, View, coarse

_PROBES = 5  # attitudes over an exposure, to measure the movement


def motion_blur(view: View, light: Light, severity: int) -> None:
    """Average the image over an exposure centred at its time; what comes in at its edges is mirrored."""
    exposure_s = EXPOSURE_S[severity]
    grid = coarse(view.mount.camera)
    shifts = _shifts(view, grid, np.linspace(-0.5, 0.5, _PROBES) * exposure_s)
    way = np.linalg.norm(np.diff(shifts, axis=0), axis=-1).sum(axis=0).max()
    n = max(1, int(np.ceil(way / MAX_STEP_PX)))
    if n == 1:
        return
    u, v = np.meshgrid(*(np.arange(k, dtype=np.float32) for k in (grid.width, grid.height)))
    total = np.zeros_like(light.linear)
    for shift in _shifts(view, grid, ((np.arange(n) + 0.5) / n - 0.5) * exposure_s):
        move = grid.fill(shift)
        total += _moved(light.linear, u + move[..., 0], v + move[..., 1])
    light.linear = total * np.float32(1.0 / n)
    light.held = cv2.blur(light.held, (STEP, STEP)) * np.float32(1.0 / n)


def _shifts(view: View, grid: Coarse, offsets_s: Floats) -> Floats:
    """(N, rows, columns, 2) px: where, from each point, the image holds what the camera sees there at an offset."""
    R_WC = view.R_WC(np.append(offsets_s, 0.0))
    R_CCk = R_WC[-1].T @ R_WC[:-1]
    rays = np.einsum("nij,rcj->nrci", R_CCk, grid.rays)
    shifts: Floats = view.mount.camera.project(rays) - grid.uv
    return shifts


def _moved(image: Plane, u: Plane, v: Plane) -> Plane:
    return np.asarray(cv2.remap(image, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101), dtype=np.float32)

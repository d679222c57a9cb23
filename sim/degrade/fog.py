"""Fog: a veil that takes the scene's light and gives its own, in banks that drift through the world.

I = T J + (1 - T) A with transmission T and air light A (Koschmieder's law, as in Narasimhan, Nayar, "Vision and the
atmosphere", IJCV 2002, eq. (7)). T = exp(-depth) is that of one distance for the whole scene, since an image does
not tell its distances: near things fade as far ones do.
"""

from dataclasses import dataclass

import numpy as np

from sim.degrade.field import Field
from sim.degrade.view import Light, View, coarse
from sim.radiance import LINEAR_MAX


@dataclass(frozen=True)
class Fog:
    """One severity.

    Attributes:
        depth: mean optical depth.
        banks: how much it varies, as a share of the mean (sd).
    """

    depth: float
    banks: float = 0.3


FOG = (Fog(0.8), Fog(1.4), Fog(1.75), Fog(2.2), Fog(3.6))
"""By severity."""
_AIR_LIGHT = 0.35 * LINEAR_MAX
_WAVES, _DETAIL, _RATE = 24, 3.0, 0.4  # banks some 40 degrees across that change in seconds
_THINNEST, _THICKEST = 0.3, 2.0  # share of the mean depth


def fog(view: View, light: Light, severity: int) -> None:
    """Put the veil before the scene."""
    wanted = FOG[severity - 1]
    grid = coarse(view.mount.camera)
    directions_W = grid.rays @ view.R_WC(np.zeros(1))[0].T
    field = Field.of(view.generator("fog"), _WAVES, _DETAIL, _RATE).at(directions_W, view.t_s)
    depth = wanted.depth * np.clip(1.0 + wanted.banks * field, _THINNEST, _THICKEST)
    transmission = grid.fill(np.exp(-depth))
    light.attenuate(transmission)
    light.add(np.float32(_AIR_LIGHT) * (np.float32(1.0) - transmission))

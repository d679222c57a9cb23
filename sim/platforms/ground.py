"""Rough ground: heights about z = 0 with the spectrum of roads."""

import numpy as np

from navcore.arrays import Floats

_SIDE = 512  # cells of a square tile, which repeats
_CELL = 0.01  # m
_LONGEST, _SHORTEST = 4.0, 0.08  # m, of the waves: a tyre of that footprint feels no shorter ones
_AT = 0.1  # cycles/m, where ISO 8608 states the roughness


class Ground:
    """Isotropic Gaussian ground, over each straight line of which goes the spectral density of ISO 8608.

    Along a line that is G(n) = G(n_0) (n / n_0)^-2 of the height, over spatial frequency n [cycles/m].
    """

    def __init__(self, roughness: float, rng: np.random.Generator) -> None:
        """Of `roughness` G(n_0) [m^3], n_0 = 0.1 cycles/m; ISO 8608 draws class A up to 32e-6, B 128e-6, C 512e-6."""
        n_x = np.fft.rfftfreq(_SIDE, _CELL)
        n_y = np.fft.fftfreq(_SIDE, _CELL)[:, None]
        n = np.hypot(n_x, n_y)
        n[0, 0] = 1.0
        band = (n > 1.0 / _LONGEST) & (n < 1.0 / _SHORTEST)
        # Seen along a line, C n^-3 in the plane sums up to 2 C n^-2 for each sign of n.
        density = np.where(band, 0.25 * roughness * _AT**2 * n**-3.0, 0.0)
        white = np.fft.rfft2(rng.standard_normal((_SIDE, _SIDE)))
        waves = white * np.sqrt(density) / _CELL
        slopes = 2.0j * np.pi * n_x * waves, 2.0j * np.pi * n_y * waves
        here = np.stack([np.fft.irfft2(w, (_SIDE, _SIDE)) for w in (waves, *slopes)], axis=-1)
        east, north = (np.roll(here, -1, axis) - here for axis in (1, 0))
        both = np.roll(east, -1, 0) - east
        self._cells = np.stack([here, east, north, both], axis=2).reshape(-1, 4, 3)

    def at(self, x: Floats, y: Floats) -> Floats:
        """(..., 3): height [m] and its slopes along x and y, at x and y (...) m; smooth also between the cells."""
        column, row = np.floor(x / _CELL), np.floor(y / _CELL)
        a, b = (x / _CELL - column)[..., None], (y / _CELL - row)[..., None]
        cell = row.astype(np.int64) % _SIDE * _SIDE + column.astype(np.int64) % _SIDE
        here, east, north, both = np.moveaxis(self._cells.take(cell, axis=0), -2, 0)
        east, north = east + b * both, north + a * both
        there: Floats = here + a * east + b * (north - a * both)
        # Heights go straight from cell to cell; how the slopes differ says how much they bend away from that.
        bend = a * (1.0 - a) * east[..., 1:2] + b * (1.0 - b) * north[..., 2:3]
        there[..., :1] -= 0.5 * _CELL * bend
        return there

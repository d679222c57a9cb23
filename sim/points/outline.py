"""Where undistorted directions fall in an image, as a table: cheap, for choosing features."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Mask, Stamps, Vectors
from navcore.camera import Camera

GRID = (8, 5)
"""Cells over an image, for spreading features evenly."""
CELLS = GRID[0] * GRID[1]

_TABLE = 64  # entries per axis
_EDGE = 8.0  # px from the edge of the image within which no feature begins


@dataclass(frozen=True)
class Outline:
    """A table over the bounding box of an image in x/z and y/z.

    Attributes:
        low: (2,) where the box begins.
        scale: (2,) entries per unit.
        cells: (64, 64), cell of the evenly filled grid, -1 where the image does not reach.
    """

    low: Floats
    scale: Floats
    cells: Stamps

    @staticmethod
    def of(camera: Camera) -> "Outline":
        """The table of a camera that sees less than 180 degrees."""
        u, v = np.meshgrid(np.linspace(0.0, camera.width - 1.0, 60), np.linspace(0.0, camera.height - 1.0, 60))
        rays = camera.unproject(np.stack([u, v], axis=-1).reshape(-1, 2))
        xy = rays[:, :2] / rays[:, 2:]
        low, scale = xy.min(axis=0), _TABLE / (xy.max(axis=0) - xy.min(axis=0))
        ij = np.stack(np.meshgrid(np.arange(_TABLE), np.arange(_TABLE), indexing="ij"), axis=-1)
        middle = np.concatenate([(ij + 0.5) / scale + low, np.ones((_TABLE, _TABLE, 1))], axis=-1)
        uv = camera.project(middle)
        cell = np.floor(uv / [camera.width, camera.height] * GRID).astype(np.int64) @ [1, GRID[0]]
        return Outline(low.astype(np.float32), scale.astype(np.float32), np.where(camera.inside(uv, _EDGE), cell, -1))

    def look_up(self, p_CF: Vectors) -> tuple[Mask, Stamps]:
        """Whether points (K, 3) before the camera are in the bounding box (K,), and their grid cell or -1 (K,)."""
        x, y, z = p_CF.T
        u, v = (x / z - self.low[0]) * self.scale[0], (y / z - self.low[1]) * self.scale[1]
        inside: Mask = (u >= 0.0) & (u < _TABLE) & (v >= 0.0) & (v < _TABLE)
        cell = np.full(len(z), -1)
        cell[inside] = self.cells[u[inside].astype(np.int64), v[inside].astype(np.int64)]
        return inside, cell

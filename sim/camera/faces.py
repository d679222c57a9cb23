"""Pinholes that together see what a lens sees.

No pinhole reaches 90 degrees off its axis, and one that comes near spends most of its pixels at the rim. So the
picture of a wide lens is cut into tiles, and each tile gets a pinhole that looks at its middle: a cube map whose
faces follow the lens. Each pixel belongs to one tile, whose face sees a little more than the tile: no seam shows.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import chain, pairwise, product
from math import prod

import numpy as np

from navcore.arrays import Floats, Rotations, Vectors
from navcore.camera import Camera
from sim.camera.lens import rays_of
from sim.errors import RenderError

_MOST_TILES = 5  # along a side
_STEP = 8.0  # px between the rays by which faces are chosen
_MIN_COSINE = 0.25  # a face reaches no further than 75 degrees from its axis
_THRIFTY = 2.1  # rendered pixels per pixel; fewer cost no less time, as more faces have to be drawn
_WASTEFUL = 12.0  # near the pole behind a lens no number of them is enough


@dataclass(frozen=True)
class Face:
    """A pinhole that looks at a tile of a picture. Its frame F has z forward, x right and y down.

    Attributes:
        columns, rows: of the picture, that the tile covers.
        R_CF: (3, 3), F to C.
        focal: (2,) rendered pixels per unit of x/z and y/z, so that along both at least one falls to each pixel.
        seen: (N, 3) bearings in F, spread over what the lens sees of the tile.
    """

    columns: slice
    rows: slice
    R_CF: Rotations
    focal: Floats
    seen: Vectors

    def tangents(self, rays: Vectors) -> Floats:
        """x/z and y/z in F (..., 2) of bearings (..., 3) in C."""
        p_FR = rays @ self.R_CF
        xy: Floats = p_FR[..., :2] / p_FR[..., 2:]
        return xy

    @cached_property
    def pixels(self) -> float:
        """How many it takes; infinite if it looks too far to the side."""
        if self.seen[:, 2].min() < _MIN_COSINE:
            return np.inf
        reach = np.ptp(self.seen[:, :2] / self.seen[:, 2:], axis=0)
        return float(np.prod(reach * self.focal))


Grid = tuple[tuple[Face, ...], ...]
"""Rows of faces; a tile of which the lens sees nothing has none."""


def faces_of(camera: Camera) -> Grid:
    """Faces that see all that a camera sees: as few as can without wasting pixels.

    Raises:
        RenderError: the camera looks so far backwards that no faces will do.
    """
    numbers = sorted(product(range(1, _MOST_TILES + 1), repeat=2), key=prod)
    grids = {_pixels(grid) / (camera.width * camera.height): grid for grid in (_grid(camera, *n) for n in numbers)}
    waste = next((ratio for ratio in grids if 0.0 < ratio < _THRIFTY), min(grids))
    if not 0.0 < waste < _WASTEFUL:
        raise RenderError(f"the camera looks too far backwards, or nowhere: no pinholes cover what it sees: {camera}")
    return grids[waste]


def _pixels(grid: Grid) -> float:
    return sum(face.pixels for face in chain(*grid))


def _grid(camera: Camera, across: int, down: int) -> Grid:
    faces = [[_face(camera, c, r) for c in _parts(camera.width, across)] for r in _parts(camera.height, down)]
    return tuple(tuple(face for face in row if face is not None) for row in faces)


def _parts(size: int, n: int) -> list[slice]:
    """`size` pixels in `n` parts."""
    return [slice(*ends) for ends in pairwise(round(k * size / n) for k in range(n + 1))]


def _face(camera: Camera, columns: slice, rows: slice) -> Face | None:
    edges = [(x.start - 0.5, x.stop - 0.5) for x in (columns, rows)]
    u, v = (np.linspace(low, high, 1 + int(np.ceil((high - low) / _STEP))) for low, high in edges)
    rays = rays_of(camera, np.stack(np.meshgrid(u, v), axis=-1))
    seen = rays[~np.isnan(rays[..., 0])]  # (N, 3)
    right, down = (_mean_step(rays, axis) for axis in (1, 0))
    if right is None or down is None:
        return None
    ahead = seen.mean(axis=0)
    U, _, Vt = np.linalg.svd(np.stack([right, down, ahead / np.linalg.norm(ahead)], axis=1))
    R_CF: Rotations = U @ Vt  # the rotation nearest to the tile's own directions
    p_FR = seen @ R_CF
    _, J = camera.project_jacobian(seen / p_FR[:, 2:])  # (N, 2, 3), at points of the plane z = 1 of F
    focal = np.linalg.norm(J @ R_CF[:, :2], axis=1).max(axis=0)
    return Face(columns, rows, R_CF, focal, p_FR)


def _mean_step(rays: Vectors, axis: int) -> Vectors | None:
    """The unit direction (3,) in which bearings (rows, columns, 3) go along an axis; None if too few are seen."""
    steps = np.diff(rays, axis=axis).reshape(-1, 3)
    total: Vectors = steps[~np.isnan(steps[:, 0])].sum(axis=0)
    length = np.linalg.norm(total)
    return total / length if length > 0.0 else None

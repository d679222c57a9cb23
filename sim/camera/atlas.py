"""The renderings of a lens's faces in one picture, and the way from there to what the lens shows."""

from dataclasses import dataclass

import cv2
import numpy as np

from navcore.arrays import Floats, Image, Rotations
from navcore.camera import Camera
from sim.camera.faces import Face, Grid
from sim.camera.lens import rays_of

_BENT = 2  # samples per pixel and axis at which renderings are bent
_MARGIN = 2  # rendered pixels around what a face must show
_NOWHERE = -100.0  # outside of every rendering


@dataclass(frozen=True)
class Pane:
    """One face as it is rendered.

    Attributes:
        R_CF: (3, 3) its frame F, z forward and y down, to the camera's.
        left, bottom, width, height: its place in the atlas [rendered px]; OpenGL's first row is the lowest.
        low, high: (2,) x/z and y/z in F at its edges.
    """

    R_CF: Rotations
    left: int
    bottom: int
    width: int
    height: int
    low: Floats
    high: Floats


class Atlas:
    """Where the pixels of a camera lie in the renderings of its faces, which share one picture.

    Attributes:
        panes: all faces.
        width, height: of the picture [rendered px].
    """

    def __init__(self, camera: Camera, faces: Grid, fine: float) -> None:
        """With at least `fine` rendered pixels per pixel of the camera and axis."""
        self._size = (camera.width, camera.height)
        samples = _BENT if fine > 1.0 else 1
        u, v = ((np.arange(n * samples) + 0.5) / samples - 0.5 for n in self._size)
        rays = rays_of(camera, np.stack(np.meshgrid(u, v), axis=-1))
        place = np.full((*rays.shape[:2], 2), _NOWHERE)
        panes: list[Pane] = []
        bottom = 0
        for row in faces:
            left, top = 0, bottom
            for face in row:
                tile = tuple(slice(samples * x.start, samples * x.stop) for x in (face.rows, face.columns))
                tangents = face.tangents(rays[tile])
                pane = _pane(face, tangents, fine, left, bottom)
                place[tile] = _in_atlas(pane, tangents)
                panes.append(pane)
                left, top = left + pane.width, max(top, bottom + pane.height)
            bottom = top
        self.panes = tuple(panes)
        self.width, self.height = max(p.left + p.width for p in panes), bottom
        x, y = np.nan_to_num(place.astype(np.float32), nan=_NOWHERE).transpose(2, 0, 1)
        self._map = cv2.convertMaps(x, y, cv2.CV_16SC2)

    def bend(self, picture: Image) -> Image:
        """The picture (height, width) as the camera sees it: bent, then averaged over each pixel; black elsewhere."""
        bent = cv2.remap(picture, *self._map, cv2.INTER_LINEAR)
        whole = (bent.shape[1], bent.shape[0]) == self._size
        seen = bent if whole else cv2.resize(bent, self._size, interpolation=cv2.INTER_AREA)
        return np.asarray(seen)


def _pane(face: Face, tangents: Floats, fine: float, left: int, bottom: int) -> Pane:
    """A face, just as large as it must be to show all of `tangents` (..., 2), nan aside."""
    focal = fine * face.focal
    low = np.floor(np.nanmin(tangents, axis=(0, 1)) * focal) - _MARGIN
    high = np.ceil(np.nanmax(tangents, axis=(0, 1)) * focal) + _MARGIN
    width, height = (high - low).astype(int).tolist()
    return Pane(face.R_CF, left, bottom, width, height, low / focal, high / focal)


def _in_atlas(pane: Pane, tangents: Floats) -> Floats:
    """Pixels (..., 2) of the atlas, its lowest row first, at which x/z and y/z (..., 2) of a face are."""
    share = (tangents - pane.low) / (pane.high - pane.low)
    x = pane.left + share[..., 0] * pane.width
    y = pane.bottom + (1.0 - share[..., 1]) * pane.height
    return np.stack([x, y], axis=-1) - 0.5

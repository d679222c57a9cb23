"""Landmarks as a rig sees them on its way: which are in the image, and where."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from navcore.arrays import Floats, Mask, Pixels, Rotations, Stamps, Vectors
from navcore.calibration import Calibration, CameraMount
from navcore.trajectory import Trajectory

GRID = (8, 5)
"""Cells over an image, for spreading features evenly."""

_TABLE = 64  # entries per axis of the table of the image's outline
_MIN_DEPTH = 0.2  # m
_CHUNK = 32  # frames whose visibility is worked out at once


@dataclass(frozen=True)
class View:
    """Landmarks of a world and the rig's poses among them.

    Attributes:
        calibration: the cameras.
        points: (L, 3) m in W.
        normals: (L, 3) of the surfaces they are on; a point is seen from that side only.
        poses: of the body at the frames.
    """

    calibration: Calibration
    points: Vectors
    normals: Vectors
    poses: Trajectory

    def pixels(self, frame: int, camera: int, which: Stamps) -> tuple[Pixels, Mask]:
        """Pixels (K, 2) of landmarks (K,) in one image, and whether they really are in it (K,)."""
        mount = self.calibration.cameras[camera]
        R_WC, p_WC = self._camera_pose(mount, frame)
        p_CF = (self.points[which] - p_WC) @ R_WC
        return mount.camera.project(p_CF), mount.camera.visible(p_CF)

    def candidates(self) -> Iterator[tuple[Mask, Stamps, Stamps]]:
        """Per frame: landmarks that camera 0 may see (L,), those it does see (K,), their image cells (K,).

        Single precision, and a table for the distortion: cheap, for choosing what to follow.
        """
        outline = _Outline.of(self.calibration.cameras[0])
        points, normals = self.points.astype(np.float32), self.normals.astype(np.float32)
        offset = np.sum(points * normals, axis=1)
        for first in range(0, len(self.poses), _CHUNK):
            frames = range(first, min(first + _CHUNK, len(self.poses)))
            poses = [self._camera_pose(self.calibration.cameras[0], k) for k in frames]
            R_WC = np.array([R for R, _ in poses], dtype=np.float32)
            p_WC = np.array([p for _, p in poses], dtype=np.float32)
            p_CF = points @ R_WC - (p_WC[:, None, :] @ R_WC)  # (F, L, 3)
            may = (p_CF[..., 2] > _MIN_DEPTH) & (p_WC @ normals.T > offset)
            for k in range(len(poses)):
                which = np.flatnonzero(may[k])
                may[k, which], cell = outline.look_up(p_CF[k, which])
                which = which[cell >= 0]
                yield may[k], which, cell[cell >= 0]

    @cached_property
    def _rotations(self) -> Rotations:
        return self.poses.R_WB

    def _camera_pose(self, mount: CameraMount, frame: int) -> tuple[Floats, Vectors]:
        R_WB, p_WB = self._rotations[frame], self.poses.p_WB[frame]
        return R_WB @ mount.R_BC, p_WB + R_WB @ mount.p_BC


@dataclass(frozen=True)
class _Outline:
    """Where undistorted directions fall in an image, as a table over the image's bounding box in x/z, y/z."""

    low: Floats  # (2,)
    scale: Floats  # (2,) table entries per unit
    cells: Stamps  # (table), cell of the evenly filled grid, -1 where the image does not reach

    @staticmethod
    def of(mount: CameraMount) -> "_Outline":
        camera = mount.camera
        u, v = np.meshgrid(np.linspace(0.0, camera.width - 1.0, 60), np.linspace(0.0, camera.height - 1.0, 60))
        rays = camera.unproject(np.stack([u, v], axis=-1).reshape(-1, 2))
        xy = rays[:, :2] / rays[:, 2:]
        low, scale = xy.min(axis=0), _TABLE / (xy.max(axis=0) - xy.min(axis=0))
        ij = np.stack(np.meshgrid(np.arange(_TABLE), np.arange(_TABLE), indexing="ij"), axis=-1)
        middle = np.concatenate([(ij + 0.5) / scale + low, np.ones((_TABLE, _TABLE, 1))], axis=-1)
        uv = camera.project(middle)
        cell = np.floor(uv / [camera.width, camera.height] * GRID).astype(np.int64) @ [1, GRID[0]]
        return _Outline(low.astype(np.float32), scale.astype(np.float32), np.where(camera.inside(uv, 8.0), cell, -1))

    def look_up(self, p_CF: Vectors) -> tuple[Mask, Stamps]:
        """Whether points (K, 3) are in the bounding box (K,), and their grid cell or -1 (K,)."""
        at = (p_CF[:, :2] / p_CF[:, 2:] - self.low) * self.scale
        inside: Mask = np.all((at >= 0.0) & (at < _TABLE), axis=1)
        i, j = np.where(inside[:, None], at, 0.0).astype(np.int64).T
        return inside, np.where(inside, self.cells[i, j], -1)

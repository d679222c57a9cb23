"""Features as a tracker would report them: followed while visible, lost by chance, replaced evenly."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from navcore.arrays import Floats, Mask, Pixels, Rotations, Stamps, Vectors
from navcore.calibration import Calibration, CameraMount
from navcore.sequence import Frame, Tracks
from navcore.trajectory import Trajectory
from sim.errors import ConfigError
from sim.schedule import Schedule

_GRID = (8, 5)  # cells over the image, filled evenly
_TABLE = 64  # entries per axis of the table of the image's outline
_MIN_DEPTH = 0.2  # m
_BORDER = 4.0  # px
_CHUNK = 32  # frames whose visibility is worked out at once

# By severity 0..5: factors on the number of features, on their life, on the pixel noise. They are what KLT does on
# rendered images of these severities, measured against the true flow, relative to clean ones.
_LOW_LIGHT = (
    (1.0, 1.0, 1.0),
    (1.0, 0.9, 1.8),
    (0.95, 0.2, 3.5),
    (0.75, 0.055, 5.0),
    (0.5, 0.022, 6.0),
    (0.2, 0.01, 7.0),
)
_MOTION_BLUR = (
    (1.0, 1.0, 1.0),
    (1.0, 1.0, 1.1),
    (0.98, 1.0, 1.2),
    (0.97, 1.0, 1.5),
    (0.94, 1.0, 1.9),
    (0.9, 1.0, 2.2),
)


@dataclass(frozen=True)
class Seeing:
    """How well features are seen."""

    pixel_noise: float = 1.0  # px, sd per axis
    max_features: int = 150  # in one image
    track_life_s: float = 3.0  # mean time until a visible feature is lost by chance

    def __post_init__(self) -> None:
        if self.pixel_noise < 0.0 or self.track_life_s <= 0.0 or self.max_features < 1:
            raise ConfigError(f"noise must not be negative, life and features must be above zero: {self}")

    def degraded(self, schedule: Schedule, t_s: float) -> "Seeing | None":
        """How it is at a time from the first frame; None in a blackout."""
        if schedule.severity("blackout", t_s):
            return None
        dark, blur = (
            _LOW_LIGHT[schedule.severity("low_light", t_s)],
            _MOTION_BLUR[schedule.severity("motion_blur", t_s)],
        )
        features, life, noise = (a * b for a, b in zip(dark, blur, strict=True))
        return Seeing(
            self.pixel_noise * noise, max(1, round(self.max_features * features)), self.track_life_s * life
        )


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
        u, v = np.meshgrid(
            np.linspace(0.0, camera.width - 1.0, 60), np.linspace(0.0, camera.height - 1.0, 60)
        )
        rays = camera.unproject(np.stack([u, v], axis=-1).reshape(-1, 2))
        xy = rays[:, :2] / rays[:, 2:]
        low, scale = xy.min(axis=0), _TABLE / (xy.max(axis=0) - xy.min(axis=0))
        ij = np.stack(np.meshgrid(np.arange(_TABLE), np.arange(_TABLE), indexing="ij"), axis=-1)
        middle = np.concatenate([(ij + 0.5) / scale + low, np.ones((_TABLE, _TABLE, 1))], axis=-1)
        uv = camera.project(middle)
        cell = np.floor(uv / [camera.width, camera.height] * _GRID).astype(np.int64) @ [1, _GRID[0]]
        return _Outline(
            low.astype(np.float32), scale.astype(np.float32), np.where(camera.inside(uv, 8.0), cell, -1)
        )

    def look_up(self, p_CF: Vectors) -> tuple[Mask, Stamps]:
        """Whether points (K, 3) are in the bounding box (K,), and their grid cell or -1 (K,)."""
        at = (p_CF[:, :2] / p_CF[:, 2:] - self.low) * self.scale
        inside: Mask = np.all((at >= 0.0) & (at < _TABLE), axis=1)
        i, j = np.where(inside[:, None], at, 0.0).astype(np.int64).T
        return inside, np.where(inside, self.cells[i, j], -1)


def follow(view: View, seeing: Seeing, schedule: Schedule, rng: np.random.Generator) -> list[Frame]:
    """The frames, with the tracks of every camera; a landmark that is lost and found again gets a new id."""
    cameras = range(len(view.calibration.cameras))
    period_s = 1.0 / view.calibration.cameras[0].rate_hz
    active, ids, next_id = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), 0
    frames = []
    t_ns = view.poses.t_ns
    for k, (may_be_seen, candidates, cells) in enumerate(view.candidates()):
        now = seeing.degraded(schedule, (int(t_ns[k]) - int(t_ns[0])) * 1e-9)
        if now is None:
            active, ids = active[:0], ids[:0]
            frames.append(Frame(int(t_ns[k]), tracks={c: Tracks(ids, np.zeros((0, 2))) for c in cameras}))
            continue
        kept = rng.random(len(active)) < np.exp(-period_s / now.track_life_s)
        kept &= may_be_seen[active]
        active, ids = active[kept], ids[kept]
        new = _chosen(candidates, cells, active, now.max_features - len(active), rng)
        active = np.concatenate([active, new])
        ids = np.concatenate([ids, next_id + np.arange(len(new))])
        next_id += len(new)
        tracks = {}
        for c in cameras:
            uv, seen = view.pixels(k, c, active)
            seen &= view.calibration.cameras[c].camera.inside(uv, _BORDER)
            noisy = uv + now.pixel_noise * rng.standard_normal(uv.shape)
            tracks[c] = Tracks(ids[seen], noisy[seen])
            if c == 0:
                active, ids = active[seen], ids[seen]
        frames.append(Frame(int(t_ns[k]), tracks=tracks))
    return frames


def _chosen(candidates: Stamps, cells: Stamps, active: Stamps, n: int, rng: np.random.Generator) -> Stamps:
    """Up to `n` candidates that are not active, from the cells of the image that hold the fewest features."""
    if n <= 0:
        return candidates[:0]
    is_active = np.isin(candidates, active, assume_unique=True, kind="table")
    load = np.bincount(cells[is_active], minlength=_GRID[0] * _GRID[1])
    free = rng.permutation(np.flatnonzero(~is_active))
    order = free[np.argsort(cells[free], kind="stable")]
    sorted_cells = cells[order]
    rank = np.arange(len(order)) - np.searchsorted(sorted_cells, sorted_cells)
    best = np.argsort(load[sorted_cells] + rank, kind="stable")[:n]
    chosen: Stamps = candidates[order[best]]
    return chosen

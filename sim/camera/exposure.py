"""What a camera gathers while its shutter is open: motion blur out of true sub-frames."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Image, Stamps, Vectors
from navcore.calibration import CameraMount
from sim.camera.lens import rays_of
from sim.camera.render import COARSE, FINE, SceneCamera
from sim.motion import Motion
from sim.world.layout import Layout
from sim.world.movers import Mover

MAX_STEP_PX = 2.0
"""How far any point of the image may move between two sub-frames."""
EXPOSURE_S = (0.0, 0.006, 0.012, 0.020, 0.030, 0.045)
"""Exposure by severity of motion_blur; a clean image is sharp."""

_GRID = (17, 11)  # points of the image that are watched
_MARGIN = 1.2  # near points between those that are watched move further
_PROBES = 7  # poses over an exposure, to measure the movement


@dataclass(frozen=True)
class Shutter:
    """Takes exposures of one camera of a rig that moves through a scene."""

    motion: Motion
    mount: CameraMount
    layout: Layout
    movers: tuple[Mover, ...] = ()

    def expose(self, camera: SceneCamera, t_ns: int, exposure_s: float) -> Image:
        """(height, width) uint16 linear radiance, the mean over an exposure centred at `t_ns`.

        Exposures are cut at the ends of the motion.
        """
        if exposure_s == 0.0:
            return camera.linear_image(self.poses(np.array([t_ns]))[0], FINE, self._seconds(t_ns))
        stamps = self.sub_stamps(t_ns, exposure_s)
        total = np.zeros((self.mount.camera.height, self.mount.camera.width), dtype=np.float32)
        for T_WC, stamp in zip(self.poses(stamps), stamps.tolist(), strict=True):
            total += camera.linear_image(T_WC, FINE if len(stamps) == 1 else COARSE, self._seconds(stamp))
        mean: Image = np.rint(total / len(stamps)).astype(np.uint16)
        return mean

    def sub_stamps(self, t_ns: int, exposure_s: float) -> Stamps:
        """(n,) ns int64, evenly over the exposure, at most `MAX_STEP_PX` of image movement apart."""
        half_ns = round(0.5e9 * exposure_s)
        low = max(t_ns - half_ns, self.motion.start_ns)
        high = min(t_ns + half_ns, self.motion.end_ns)
        n = max(1, int(np.ceil(self._movement(low, high) / MAX_STEP_PX)))
        stamps: Stamps = low + ((np.arange(n) + 0.5) * (high - low) / n).astype(np.int64)
        return stamps

    def poses(self, t_ns: Stamps) -> Floats:
        """T_WC (N, 4, 4) at stamps (N,)."""
        states = self.motion.at(t_ns)
        T_WB = np.tile(np.eye(4), (len(states), 1, 1))
        T_WB[:, :3, :3], T_WB[:, :3, 3] = states.R_WB, states.p_WB
        T_WC: Floats = T_WB @ self.mount.T_BC
        return T_WC

    def _seconds(self, t_ns: int) -> float:
        return (t_ns - self.motion.start_ns) * 1e-9

    def _movement(self, low_ns: int, high_ns: int) -> float:
        """Length of the way [px] of the point that is fastest in the image, had it always its greatest speed."""
        stamps: Stamps = np.linspace(low_ns, high_ns, _PROBES).astype(np.int64)
        poses = self.poses(stamps)
        still = np.tile(self._points_seen(poses[_PROBES // 2]), (_PROBES, 1, 1))
        t_s = np.asarray((stamps - self.motion.start_ns) * 1e-9, dtype=np.float64)
        points = np.concatenate([still, *(mover.corners(t_s) for mover in self.movers)], axis=1)
        p_CF = (points - poses[:, None, :3, 3]) @ poses[:, :3, :3]
        uv, seen = self.mount.camera.project(p_CF), self.mount.camera.unfolded(p_CF)
        steps = np.linalg.norm(np.diff(uv, axis=0), axis=2) * (seen[1:] & seen[:-1])
        return float(_MARGIN * (_PROBES - 1) * steps.max(initial=0.0))

    def _points_seen(self, T_WC: Floats) -> Vectors:
        camera = self.mount.camera
        u = np.linspace(0.0, camera.width - 1.0, _GRID[0])
        v = np.linspace(0.0, camera.height - 1.0, _GRID[1])
        rays = rays_of(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        rays_W = rays[~np.isnan(rays[:, 0])] @ T_WC[:3, :3].T
        start = np.tile(T_WC[:3, 3], (len(rays_W), 1))
        points: Vectors = start + self.layout.distance(start, rays_W)[:, None] * rays_W
        return points

"""Features seen from poses: the arrays that triangulation and the visual update share."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Mask, Pixels, Rotations, Stamps, Vectors
from navcore.calibration import CameraMount
from navcore.camera import Camera

INTRINSICS_SIZE = 8


@dataclass(frozen=True)
class Rig:
    """The cameras in use, where they sit and how they project: as they were calibrated, or as estimated since.

    Attributes:
        mounts: the cameras as calibrated.
        poses: R_BC (C, 3, 3) and p_BC (C, 3) that differ from the calibration, or None.
        intrinsics: (C, 8) that differ from the calibration, or None.
    """

    mounts: tuple[CameraMount, ...]
    poses: tuple[Rotations, Vectors] | None = None
    intrinsics: Floats | None = None

    def __len__(self) -> int:
        return len(self.mounts)

    @cached_property
    def cameras(self) -> tuple[Camera, ...]:
        """The projections in use."""
        calibrated = tuple(mount.camera for mount in self.mounts)
        if self.intrinsics is None:
            return calibrated
        return tuple(camera.with_intrinsics(x) for camera, x in zip(calibrated, self.intrinsics, strict=True))

    @cached_property
    def R_BC(self) -> Rotations:
        """(C, 3, 3)."""
        return np.stack([m.R_BC for m in self.mounts]) if self.poses is None else self.poses[0]

    @cached_property
    def p_BC(self) -> Vectors:
        """(C, 3)."""
        return np.stack([m.p_BC for m in self.mounts]) if self.poses is None else self.poses[1]

    def sits_elsewhere(self, d: Floats) -> "Rig":
        """The rig after an error (C, 6) of the cameras' poses: dtheta on the right of R_BC, dp in B."""
        return replace(self, poses=(so3.normalise(self.R_BC @ so3.exp(d[:, :3])), self.p_BC + d[:, 3:]))

    def projects_otherwise(self, d: Floats) -> "Rig":
        """The rig after an error (C, 8) of the intrinsics."""
        return replace(self, intrinsics=np.stack([camera.intrinsics for camera in self.cameras]) + d)

    def project_jacobian(self, cameras: Stamps, p_CF: Vectors) -> tuple[Pixels, Floats]:
        """Pixels (..., N, 2) and derivatives (..., N, 2, 3) of points (..., N, 3), point n through `cameras[n]`."""
        if len(self) == 1:
            return self.cameras[0].project_jacobian(p_CF)
        uv, J = np.empty((*p_CF.shape[:-1], 2)), np.empty((*p_CF.shape[:-1], 2, 3))
        for c, camera in enumerate(self.cameras):
            n = np.flatnonzero(cameras == c)
            uv[..., n, :], J[..., n, :, :] = camera.project_jacobian(p_CF.take(n, axis=-2))
        return uv, J

    def by_intrinsics(self, cameras: Stamps, p_CF: Vectors) -> Floats:
        """Derivatives (..., N, 2, 8) of the same pixels by the intrinsics of the camera that each goes through."""
        J = np.empty((*p_CF.shape[:-1], 2, INTRINSICS_SIZE))
        for c, camera in enumerate(self.cameras):
            n = cameras == c
            J[..., n, :, :] = camera.by_intrinsics(p_CF[..., n, :])
        return J

    def unproject(self, cameras: Stamps, uv: Pixels) -> Vectors:
        """Unit bearings (..., N, 3) of pixels (..., N, 2)."""
        bearings = np.empty((*uv.shape[:-1], 3))
        for c, camera in enumerate(self.cameras):
            n = cameras == c
            bearings[..., n, :] = camera.unproject(uv[..., n, :])
        return bearings


@dataclass(frozen=True)
class Views:
    """Observations of F features from K body poses through C cameras: V = K C views, those of one pose side by side.

    Attributes:
        rig: the cameras.
        uv: (F, V, 2) px; anything where not seen.
        seen: (F, V).
        bearings: (F, V, 3) the pixels as unit vectors in C, any where not seen; computed unless they are at hand.
    """

    rig: Rig
    uv: Pixels
    seen: Mask
    bearings: Vectors | None = None

    @property
    def count(self) -> int:
        """K, the number of poses."""
        return int(self.seen.shape[1]) // len(self.rig)

    @cached_property
    def cameras(self) -> Stamps:
        """(V,) the camera of each view."""
        return np.tile(np.arange(len(self.rig)), self.count)

    @cached_property
    def poses(self) -> Stamps:
        """(V,) the pose of each view."""
        return np.repeat(np.arange(self.count), len(self.rig))

    @cached_property
    def rays(self) -> Vectors:
        """(F, V, 3) unit bearings in C."""
        return self.rig.unproject(self.cameras, self.uv) if self.bearings is None else self.bearings

    @cached_property
    def by_bearing(self) -> Floats:
        """(F, V, 2, 3) px, derivative of each pixel by its bearing; zero where not seen."""
        return self.rig.project_jacobian(self.cameras, self.rays)[1] * self.seen[..., None, None]

    @cached_property
    def last(self) -> Stamps:
        """(F,) the last view that saw each feature."""
        return np.asarray(self.seen.shape[1] - 1 - np.argmax(self.seen[:, ::-1], axis=1))

    def camera_poses(self, R_WB: Rotations, p_WB: Vectors) -> tuple[Rotations, Vectors]:
        """R_WC (V, 3, 3) and p_WC (V, 3) of every view, for body poses (K, 3, 3), (K, 3)."""
        R_WC = (R_WB[:, None] @ self.rig.R_BC).reshape(-1, 3, 3)
        p_WC = (p_WB[:, None] + self.rig.p_BC @ np.swapaxes(R_WB, -1, -2)).reshape(-1, 3)
        return R_WC, p_WC

    def rows(self, mask: Mask) -> "Views":
        """Only some of the features."""
        return Views(self.rig, self.uv[mask], self.seen[mask], self.rays[mask])

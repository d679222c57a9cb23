"""Features seen from poses: the arrays that triangulation and the visual update share."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from navcore import so3
from navcore.arrays import Floats, Mask, Pixels, Rotations, Stamps, Vectors
from navcore.calibration import CameraMount


@dataclass(frozen=True)
class Rig:
    """The cameras in use, and where they sit: as they were calibrated, or as estimated since.

    Attributes:
        mounts: the cameras as calibrated.
        estimated: R_BC (C, 3, 3) and p_BC (C, 3) that differ from the calibration, or None.
    """

    mounts: tuple[CameraMount, ...]
    estimated: tuple[Rotations, Vectors] | None = None

    @cached_property
    def R_BC(self) -> Rotations:
        """(C, 3, 3)."""
        return np.stack([m.R_BC for m in self.mounts]) if self.estimated is None else self.estimated[0]

    @cached_property
    def p_BC(self) -> Vectors:
        """(C, 3)."""
        return np.stack([m.p_BC for m in self.mounts]) if self.estimated is None else self.estimated[1]

    def moved(self, d: Floats) -> "Rig":
        """The rig after an error state (C, 6): dtheta on the right of R_BC, dp in B."""
        return Rig(self.mounts, (so3.normalise(self.R_BC @ so3.exp(d[:, :3])), self.p_BC + d[:, 3:]))

    def project_jacobian(self, cameras: Stamps, p_CF: Vectors) -> tuple[Pixels, Floats]:
        """Pixels (F, K, 2) and derivatives (F, K, 2, 3) of points (F, K, 3), row f through camera `cameras[f]`."""
        if len(self.mounts) == 1:
            return self.mounts[0].camera.project_jacobian(p_CF)
        uv, J = np.empty((*p_CF.shape[:-1], 2)), np.empty((*p_CF.shape[:-1], 2, 3))
        for c, mount in enumerate(self.mounts):
            rows = cameras == c
            uv[rows], J[rows] = mount.camera.project_jacobian(p_CF[rows])
        return uv, J

    def unproject(self, cameras: Stamps, uv: Pixels) -> Vectors:
        """Unit bearings (F, ..., 3) of pixels (F, ..., 2), row f through camera `cameras[f]`."""
        bearings = np.empty((*uv.shape[:-1], 3))
        for c, mount in enumerate(self.mounts):
            rows = cameras == c
            bearings[rows] = mount.camera.unproject(uv[rows])
        return bearings


@dataclass(frozen=True)
class Views:
    """Observations of F features from K body poses.

    Attributes:
        rig: the cameras.
        cameras: (F,) which camera saw each feature.
        uv: (F, K, 2) px; anything where not seen.
        seen: (F, K).
        bearings: (F, K, 3) the pixels as unit vectors in C; computed unless they are at hand.
    """

    rig: Rig
    cameras: Stamps
    uv: Pixels
    seen: Mask
    bearings: Vectors | None = None

    @cached_property
    def rays(self) -> Vectors:
        """(F, K, 3) unit bearings in C."""
        return self.rig.unproject(self.cameras, self.uv) if self.bearings is None else self.bearings

    def camera_poses(self, R_WB: Rotations, p_WB: Vectors) -> tuple[Rotations, Vectors]:
        """R_WC (F, K, 3, 3) and p_WC (F, K, 3) of every view, for body poses (K, 3, 3), (K, 3)."""
        R_WC = R_WB[None] @ self.rig.R_BC[:, None]  # (C, K, 3, 3)
        p_WC = p_WB[None] + (R_WB[None] @ self.rig.p_BC[:, None, :, None])[..., 0]
        return R_WC[self.cameras], p_WC[self.cameras]

    def rows(self, mask: Mask) -> "Views":
        """Only some of the features."""
        return Views(self.rig, self.cameras[mask], self.uv[mask], self.seen[mask], self.rays[mask])

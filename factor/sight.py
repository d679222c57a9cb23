"""Features seen from keyframes, as GTSAM's smart factors: their positions are eliminated inside.

A camera of any lens is taken apart into five pinhole cameras without distortion, the sides of a cube around it; a
feature is seen through the one that it is nearest the axis of. How much that stretches a pixel its noise knows.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from factor.config import WindowConfig
from navcore import so3
from navcore.arrays import Floats, Mask, Rotations, Stamps
from navcore.calibration import CameraMount
from navcore.frontend import Observations
from navcore.pixel_noise import PixelNoise

_RANK_TOLERANCE = 1e-1  # of triangulation, below which a feature has no parallax


View: TypeAlias = tuple[int, int, Floats, float]
"""Number of the frame, index of the side, px (2,) from its axis, size of a pixel there."""
Factor: TypeAlias = gtsam.SmartProjectionRigFactorPinholePoseCal3_S2


@dataclass(frozen=True)
class Sight:
    """One feature.

    Attributes:
        factor: of its views.
        dof: of their residuals, its position being fitted.
        now: whether the newest frame saw it.
    """

    factor: Factor
    dof: float
    now: bool


def _sides() -> Rotations:
    """(5, 3, 3) from a side's frame to the camera's: ahead, right, left, down, up; z is the axis of each."""
    x, y, z = np.eye(3)
    return np.stack([np.column_stack(s) for s in ((x, y, z), (-z, y, x), (z, y, -x), (x, -z, y), (x, z, -y))])


@dataclass(frozen=True)
class Seen:
    """Observations of one frame through the sides.

    Attributes:
        keys: (N,) features; sides: (N,) index of the side; points: (N, 2) px from its axis.
        stretch: (N,) size there of a pixel of the image.
        directions: (N, 3) unit vectors in B.
        first: (N,) whether through the first camera.
    """

    keys: Stamps
    sides: Stamps
    points: Floats
    stretch: Floats
    directions: Floats
    first: Mask

    def views(self, frame: int) -> Iterator[tuple[int, View]]:
        """Feature and view, one after the other, from a frame of this number."""
        rows = zip(self.keys.tolist(), self.sides.tolist(), self.points, self.stretch.tolist(), strict=True)
        return ((key, (frame, side, point, stretch)) for key, side, point, stretch in rows)


class Sides:
    """All sides of all cameras of a rig."""

    def __init__(self, mounts: tuple[CameraMount, ...], config: WindowConfig) -> None:
        self._mounts = mounts
        self._R_CS = _sides()
        self._rig = gtsam.CameraSetPinholePoseCal3_S2()
        for mount in mounts:
            lens = gtsam.Cal3_S2(mount.camera.focal, mount.camera.focal, 0.0, 0.0, 0.0)
            for R_CS in self._R_CS:
                pose = gtsam.Pose3(gtsam.Rot3(mount.R_BC @ R_CS), mount.p_BC)
                self._rig.push_back(gtsam.PinholePoseCal3_S2(pose, lens))
        self.noise = PixelNoise(config)
        self._params = gtsam.SmartProjectionParams(
            gtsam.LinearizationMode.HESSIAN, gtsam.DegeneracyMode.ZERO_ON_DEGENERACY
        )
        self._params.setRankTolerance(_RANK_TOLERANCE)

    def see(self, observations: Observations) -> Seen:
        """Observations through the sides."""
        along = observations.bearings @ self._R_CS[:, :, 2].T  # (N, 5), cosine to each axis
        side = np.argmax(along, axis=1)
        in_side = np.einsum("nij,ni->nj", self._R_CS[side], observations.bearings)
        focal = np.array([mount.camera.focal for mount in self._mounts])[observations.cameras]
        points = focal[:, None] * in_side[:, :2] / in_side[:, 2:]
        stretch = np.sqrt(focal**2 / in_side[:, 2] ** 3 / self._pixels_by_solid_angle(observations))
        R_BC = np.stack([mount.R_BC for mount in self._mounts])[observations.cameras]
        directions = np.einsum("nij,nj->ni", R_BC, observations.bearings)
        sides = observations.cameras * len(self._R_CS) + side
        return Seen(observations.keys, sides, points, stretch, directions, observations.cameras == 0)

    def _pixels_by_solid_angle(self, observations: Observations) -> Floats:
        """(N,) px^2 by steradian of the image at each observation."""
        found = np.empty(len(observations))
        for c, mount in enumerate(self._mounts):
            mine = observations.cameras == c
            bearings = observations.bearings[mine]
            _, J = mount.camera.project_jacobian(bearings)
            found[mine] = np.abs((so3.cross(J[:, 0], J[:, 1]) * bearings).sum(axis=1))
        return found

    def sight(self, views: Sequence[View], newest: int) -> Sight:
        """Of a feature that has these views, in the order of the frames."""
        frames, sides, points, stretch = zip(*views, strict=True)
        noise = gtsam.noiseModel.Isotropic.Sigma(2, self.noise.sigma * sum(stretch) / len(stretch))
        factor: Factor = gtsam.SmartProjectionRigFactorPinholePoseCal3_S2(noise, self._rig, self._params)
        factor.add(points, [X(k) for k in frames], sides)
        return Sight(factor, 2.0 * len(views) - 3.0, views[-1][0] == newest)

"""Features seen from keyframes, as GTSAM's smart factors: their positions are eliminated inside.

A camera of any lens is taken apart into five pinhole cameras without distortion, the sides of a cube around it; a
feature is seen through the one that it is nearest the axis of. Each pixel keeps its size near that axis.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeAlias

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from factor.config import WindowConfig
from navcore.arrays import Floats, Rotations, Stamps
from navcore.calibration import CameraMount
from navcore.frontend import Observations
from navcore.pixel_noise import PixelNoise

_RANK_TOLERANCE = 1e-1  # of triangulation, below which a feature has no parallax


Sight: TypeAlias = gtsam.SmartProjectionRigFactorPinholePoseCal3_S2
"""The factor of one feature."""


def _sides() -> Rotations:
    """(5, 3, 3) from a side's frame to the camera's: ahead, right, left, down, up; z is the axis of each."""
    x, y, z = np.eye(3)
    return np.stack([np.column_stack(s) for s in ((x, y, z), (-z, y, x), (z, y, -x), (x, -z, y), (x, z, -y))])


@dataclass(frozen=True)
class Seen:
    """Observations of one frame through the sides.

    Attributes:
        keys: (N,) features; sides: (N,) index of the side; points: (N, 2) px from its axis.
        directions: (N, 3) unit vectors in B.
        first: (N,) whether through the first camera.
    """

    keys: Stamps
    sides: Stamps
    points: Floats
    directions: Floats
    first: Stamps


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
        self._params.setDynamicOutlierRejectionThreshold(config.max_misfit)

    def see(self, observations: Observations) -> Seen:
        """Observations through the sides."""
        along = observations.bearings @ self._R_CS[:, :, 2].T  # (N, 5), cosine to each axis
        side = np.argmax(along, axis=1)
        in_side = np.einsum("nij,ni->nj", self._R_CS[side], observations.bearings)
        focal = np.array([mount.camera.focal for mount in self._mounts])[observations.cameras]
        points = focal[:, None] * in_side[:, :2] / in_side[:, 2:]
        R_BC = np.stack([mount.R_BC for mount in self._mounts])[observations.cameras]
        directions = np.einsum("nij,nj->ni", R_BC, observations.bearings)
        sides = observations.cameras * len(self._R_CS) + side
        return Seen(observations.keys, sides, points, directions, observations.cameras == 0)

    def learn(self, sights: list[Sight], values: gtsam.Values) -> None:
        """Learn the noise from how well features are explained, by what their positions leave of it."""
        misfit = np.array([2.0 * sight.error(values) for sight in sights])
        dof = np.array([2.0 * len(sight.measured()) - 3.0 for sight in sights])
        self.noise.learn(misfit, dof)

    def factor(self, views: Iterable[tuple[int, int, Floats]]) -> Sight:
        """Of a feature that was seen from frames k through sides s at points p: (k, s, p) each."""
        frames, sides, points = zip(*views, strict=True)
        noise = gtsam.noiseModel.Isotropic.Sigma(2, self.noise.sigma)
        factor: Sight = gtsam.SmartProjectionRigFactorPinholePoseCal3_S2(noise, self._rig, self._params)
        factor.add(points, [X(k) for k in frames], sides)
        return factor

"""One image of a sequence, as far as a degradation may know it, and the light in it."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from zlib import crc32

import cv2
import numpy as np

from navcore.arrays import Floats, Image, Pixels, Vectors
from navcore.calibration import CameraMount
from navcore.camera import Camera
from sim.camera.sensor import Plane, noise_variance
from sim.degrade.attitude import Attitude
from sim.radiance import decode

STEP = 16
"""Pixels between the points at which smooth things are worked out."""


@dataclass(frozen=True)
class View:
    """One image among its sequence.

    Attributes:
        seed: of everything random.
        camera: its index.
        index: of the frame in the sequence.
        t_s: seconds from the first frame.
        t_ns: camera time.
        mount: the camera.
        attitude: of the rig.
    """

    seed: int
    camera: int
    index: int
    t_s: float
    t_ns: int
    mount: CameraMount
    attitude: Attitude

    def R_WC(self, offsets_s: Floats) -> Floats:
        """(N, 3, 3) attitude of the camera at offsets (N,) s from the image's time."""
        middle_ns = self.t_ns + round(self.mount.dt_cam_imu * 1e9)
        R_WB = self.attitude.at(middle_ns + np.rint(offsets_s * 1e9).astype(np.int64))
        R_WC: Floats = R_WB @ self.mount.R_BC
        return R_WC

    def generator(self, what: str) -> np.random.Generator:
        """Draws what is the same in all images of all cameras of a sequence: the lamps, the things that move."""
        return np.random.default_rng((self.seed, crc32(what.encode())))


@dataclass
class Light:
    """Linear radiance of one image on its way to the sensor; stages change it in place.

    Attributes:
        linear: (height, width), 0 to `sim.radiance.LINEAR_MAX`.
        held: (height, width) variance [electrons^2] of the noise that came with the image and is in it still.
    """

    linear: Plane
    held: Plane

    @staticmethod
    def of(image: Image) -> "Light":
        """The light behind an image, whose own noise is taken to be what the sensor would give."""
        linear = decode(image).astype(np.float32)
        return Light(linear, noise_variance(linear))

    def attenuate(self, share: Plane) -> None:
        """Let a share (height, width) of the light through."""
        self.linear *= share
        self.held *= share * share

    def add(self, veil: Plane) -> None:
        """Add light that brings shot noise of its own."""
        self.linear += veil


@dataclass(frozen=True)
class Coarse:
    """Points of an image `STEP` px apart, one cell beyond its edges, for what changes smoothly over it.

    Attributes:
        uv: (rows, columns, 2) px.
        rays: (rows, columns, 3) unit bearings in C.
    """

    width: int
    height: int
    uv: Pixels
    rays: Vectors

    def fill(self, values: Floats) -> Plane:
        """(height, width[, k]) float32: values (rows, columns[, k]) brought to all pixels, linearly."""
        rows, columns = self.uv.shape[:2]
        big = cv2.resize(values.astype(np.float32), (columns * STEP, rows * STEP), interpolation=cv2.INTER_LINEAR)
        filled: Plane = np.ascontiguousarray(big[STEP : STEP + self.height, STEP : STEP + self.width])
        return filled

    @cached_property
    def all_rays(self) -> Plane:
        """(height, width, 3) float32 bearings of all pixels, unit to a few parts in 10 000."""
        return self.fill(self.rays)


@lru_cache(maxsize=8)
def coarse(camera: Camera) -> Coarse:
    """The coarse points of a camera."""
    u, v = ((np.arange(-1, -(-n // STEP) + 1) + 0.5) * STEP - 0.5 for n in (camera.width, camera.height))
    uv = np.stack(np.meshgrid(u, v), axis=-1)
    return Coarse(camera.width, camera.height, uv, camera.unproject(uv))

"""A recording as an estimator sees it: IMU, frames with images or tracks, and truth if there is any."""

from collections.abc import Iterator, Mapping
from collections.abc import Sequence as ListLike
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from navcore.arrays import Image, Pixels, Stamps, frozen
from navcore.calibration import Calibration
from navcore.errors import DataError
from navcore.imu import ImuSamples
from navcore.trajectory import Trajectory


class ImageSource(Protocol):
    """Gives the grey image of one camera at one time when it is asked."""

    def load(self) -> Image:
        """(height, width) uint8.

        Raises:
            DataError: no image can be had; the message names it.
        """
        ...


@dataclass(frozen=True)
class ImageFile:
    """An image on disk, read when asked for."""

    path: Path
    width: int
    height: int

    def load(self) -> Image:
        """The grey image; a missing, corrupt or wrongly sized file raises `DataError`."""
        if not self.path.is_file():
            raise DataError(f"{self.path}: no such image")
        data = np.frombuffer(self.path.read_bytes(), dtype=np.uint8)
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
        if image is None:
            raise DataError(f"{self.path}: corrupt image, cannot be decoded")
        if image.shape != (self.height, self.width):
            h, w = image.shape[:2]
            raise DataError(f"{self.path}: image is {w}x{h}, calibration says {self.width}x{self.height}")
        return np.asarray(image, dtype=np.uint8)


@dataclass(frozen=True)
class ImageArray:
    """An image in memory, for live use."""

    image: Image

    def load(self) -> Image:
        """The image itself."""
        return self.image


@dataclass(frozen=True)
class Tracks:
    """Features seen in one image.

    Attributes:
        ids: (N,) int64, the same number for the same feature from frame to frame; never reused.
        uv: (N, 2) px.
    """

    ids: Stamps
    uv: Pixels

    def __post_init__(self) -> None:
        n = len(self.ids)
        object.__setattr__(self, "ids", frozen("ids", self.ids, np.int64, (None,)))
        object.__setattr__(self, "uv", frozen("uv", self.uv, np.float64, (n, 2)))

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True)
class Frame:
    """What the cameras saw at one time: images or tracks, by camera index; a camera may be missing.

    Attributes:
        t_ns: camera time [ns]; IMU time is `t_ns + dt_cam_imu`.
        images: camera index to image source.
        tracks: camera index to tracks.
    """

    t_ns: int
    images: Mapping[int, ImageSource] = field(default_factory=dict)
    tracks: Mapping[int, Tracks] = field(default_factory=dict)


@dataclass(frozen=True)
class Sequence:
    """A recording.

    Attributes:
        name: for people; nothing is chosen by it.
        calibration: of the rig.
        imu: all samples.
        frames: in time order; images are read when asked for.
        truth: the path of the body, or None.
        notes: what the reader left out or mended, a line each.
    """

    name: str
    calibration: Calibration
    imu: ImuSamples
    frames: ListLike[Frame]
    truth: Trajectory | None = None
    notes: tuple[str, ...] = ()

    def span(self, start_s: float | None = None, end_s: float | None = None) -> "Sequence":
        """The part between two times, in seconds from the first frame; IMU from 0.1 s before it is kept."""
        if not self.frames:
            raise DataError(f"{self.name}: has no frames to cut by")
        zero = self.frames[0].t_ns
        low = zero + round((start_s or 0.0) * 1e9)
        high = zero + round(end_s * 1e9) if end_s is not None else self.frames[-1].t_ns
        frames = [f for f in self.frames if low <= f.t_ns <= high]
        if not frames:
            last = (self.frames[-1].t_ns - zero) * 1e-9
            wanted = f"no frame between {start_s} s and {end_s} s"
            raise DataError(f"{self.name}: {wanted}; frames end at {last:.2f} s")
        imu = self.imu if start_s is None else self.imu.between(low - 100_000_000, int(self.imu.t_ns[-1]) + 1)
        return replace(self, frames=frames, imu=imu)

    def events(self) -> Iterator[ImuSamples | Frame]:
        """IMU chunks and frames in the order in which a live system would see them.

        A frame comes after every sample stamped before it (in IMU time), as from a driver without delay.
        """
        offset = max((c.dt_cam_imu for c in self.calibration.cameras), default=0.0)
        done = 0
        for frame in self.frames:
            upto = int(np.searchsorted(self.imu.t_ns, frame.t_ns + round(offset * 1e9), side="right"))
            if upto > done:
                yield self.imu[done:upto]
                done = upto
            yield frame
        if done < len(self.imu):
            yield self.imu[done:]

"""Frames become observations: images are tracked, tracks are passed on, faults are named."""

from dataclasses import dataclass

import numpy as np

from msckf.clock import stage
from msckf.views import Rig
from navcore.arrays import Floats, Mask, Rotations, Stamps
from navcore.errors import DataError
from navcore.odometry import SKIPPED
from navcore.sequence import Frame, Tracks
from navcore.tracker import Tracker, TrackerConfig


@dataclass(frozen=True)
class Observations:
    """What all cameras followed into one frame.

    Attributes:
        keys: (N,) feature numbers, unique over cameras.
        cameras: (N,) camera index.
        uv: (N, 2) px.
        bearings: (N, 3) the same as unit vectors in C.
        faults: what was wrong with the images.
    """

    keys: Stamps
    cameras: Stamps
    uv: Floats
    bearings: Floats
    faults: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.keys)

    def tracks(self) -> dict[int, Tracks]:
        """The same by camera, with each feature's number there."""
        found = {}
        for c in np.unique(self.cameras).tolist():
            mine = self.cameras == c
            found[c] = Tracks(self.keys[mine], self.uv[mine])
        return found

    def rows(self, mask: Mask) -> "Observations":
        """Only some of them."""
        return Observations(self.keys[mask], self.cameras[mask], self.uv[mask], self.bearings[mask], self.faults)


class Frontend:
    """One tracker per camera, and the rotation since each last saw something."""

    def __init__(self, rig: Rig, config: TrackerConfig) -> None:
        self._rig = rig
        self._trackers = [Tracker(mount.camera, config) for mount in rig.mounts]
        self._since: list[Rotations | None] = [np.eye(3) for _ in rig.mounts]

    def observe(self, frame: Frame, R_B1B0: Rotations | None, stages: dict[str, float]) -> Observations:
        """Observations of a frame.

        Args:
            frame: images or tracks.
            R_B1B0: the body's rotation since the last frame, None if it is not known.
            stages: gets the CPU seconds of `decode` and `track`.
        """
        parts, faults = [], []
        for c in range(len(self._trackers)):
            since = self._since[c]
            self._since[c] = None if R_B1B0 is None or since is None else R_B1B0 @ since
            try:
                part = self._one(frame, c, stages)
            except DataError as error:
                faults.append(f"{SKIPPED}: camera {c}: {error}")
                continue
            self._since[c] = np.eye(3)
            parts.append(part)
            faults += part.faults
        empty = np.zeros(0, dtype=np.int64)
        return Observations(
            np.concatenate([empty, *(p.keys for p in parts)]),
            np.concatenate([empty, *(p.cameras for p in parts)]),
            np.concatenate([np.zeros((0, 2)), *(p.uv for p in parts)]),
            np.concatenate([np.zeros((0, 3)), *(p.bearings for p in parts)]),
            tuple(faults),
        )

    def _one(self, frame: Frame, c: int, stages: dict[str, float]) -> Observations:
        """Observations of one camera."""
        camera = self._rig.mounts[c].camera
        faults: tuple[str, ...] = ()
        if c in frame.tracks:
            tracks = frame.tracks[c]
            bearings = camera.unproject(tracks.uv)
        elif c in frame.images:
            with stage(stages, "decode"):
                image = frame.images[c].load()
            if image.shape != (camera.height, camera.width) or image.dtype != np.uint8:
                size = f"{image.shape[1]}x{image.shape[0]}" if image.ndim == 2 else f"of shape {image.shape}"
                raise DataError(f"image is {size} {image.dtype}, expected {camera.width}x{camera.height} uint8")
            R_BC, R_B1B0 = self._rig.mounts[c].R_BC, self._since[c]
            with stage(stages, "track"):
                tracker = self._trackers[c]
                tracks = tracker.track(image, None if R_B1B0 is None else R_BC.T @ R_B1B0 @ R_BC)
                bearings = tracker.bearings
            if tracker.quality.fault is not None:
                faults = (f"{tracker.quality.fault}, camera {c}",)
        else:
            raise DataError("no image")
        cameras = np.full(len(tracks), c, dtype=np.int64)
        return Observations(tracks.ids * len(self._trackers) + c, cameras, tracks.uv, bearings, faults)

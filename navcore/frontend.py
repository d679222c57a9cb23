"""Frames become observations: images are tracked and matched, tracks are passed on, faults are named."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Floats, Image, Mask, Rotations, Stamps, among
from navcore.calibration import CameraMount
from navcore.clock import stage
from navcore.errors import DataError
from navcore.odometry import SKIPPED
from navcore.sequence import Frame, Tracks
from navcore.tracker import Numbers, StereoMatcher, Tracker, TrackerConfig


@dataclass(frozen=True)
class Observations:
    """What all cameras followed into one frame.

    Attributes:
        keys: (N,) feature numbers; the same one in several cameras is the same feature, once in each.
        cameras: (N,) camera index.
        uv: (N, 2) px.
        bearings: (N, 3) the same as unit vectors in C.
        faults: what was wrong with the images.
        blind: cameras that had no image of use, but whose features may still be followed into the next.
    """

    keys: Stamps
    cameras: Stamps
    uv: Floats
    bearings: Floats
    faults: tuple[str, ...] = ()
    blind: tuple[int, ...] = ()

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
        keys, cameras, uv, bearings = self.keys[mask], self.cameras[mask], self.uv[mask], self.bearings[mask]
        return Observations(keys, cameras, uv, bearings, self.faults, self.blind)


class Frontend:
    """One tracker per camera, matchers of the first with each other, and the rotation since each last saw something."""

    def __init__(self, mounts: tuple[CameraMount, ...], config: TrackerConfig) -> None:
        self._mounts = mounts
        numbers = Numbers()
        self._trackers = [Tracker(mount.camera, config, numbers) for mount in mounts]
        first, *others = zip(mounts, self._trackers, strict=True)
        self._matchers = [StereoMatcher(*first, *other) for other in others]
        self._since: list[Rotations | None] = [np.eye(3) for _ in mounts]
        self._max_skipped = config.max_skipped
        self._skipped = [0 for _ in mounts]

    def observe(self, frame: Frame, R_B1B0: Rotations | None, stages: dict[str, float]) -> Observations:
        """Observations of a frame.

        Args:
            frame: images or tracks.
            R_B1B0: the body's rotation since the last frame, None if it is not known.
            stages: gets the CPU seconds of `decode` and `track`.
        """
        self._since = [None if R_B1B0 is None or R is None else R_B1B0 @ R for R in self._since]
        parts: list[tuple[int, Tracks, Floats]] = []
        faults: list[str] = []
        first_sees = False
        for c, tracker in enumerate(self._trackers):
            self._skipped[c] += 1
            if c in frame.tracks:
                tracks = frame.tracks[c]
                parts.append((c, tracks, tracker.camera.unproject(tracks.uv)))
                self._skipped[c] = 0
                continue
            try:
                with stage(stages, "decode"):
                    image = self._image(frame, c)
            except DataError as error:
                faults.append(f"{SKIPPED}: camera {c}: {error}")
                tracker.skip()
                continue
            with stage(stages, "track"):
                sees = self._track(c, image, first_sees)
                first_sees |= sees and c == 0
            if tracker.quality.fault is not None:
                faults.append(f"{tracker.quality.fault}, camera {c}")
            if sees:
                parts.append((c, tracker.tracks, tracker.bearings))
                self._skipped[c] = 0
        blind = tuple(c for c, skipped in enumerate(self._skipped) if 0 < skipped <= self._max_skipped)
        return _joined(parts, tuple(faults), blind)

    def _image(self, frame: Frame, c: int) -> Image:
        if c not in frame.images:
            raise DataError("no image")
        camera, image = self._mounts[c].camera, frame.images[c].load()
        if image.shape != (camera.height, camera.width) or image.dtype != np.uint8:
            size = f"{image.shape[1]}x{image.shape[0]}" if image.ndim == 2 else f"of shape {image.shape}"
            raise DataError(f"image is {size} {image.dtype}, expected {camera.width}x{camera.height} uint8")
        return image

    def _track(self, c: int, image: Image, first_sees: bool) -> bool:
        """Follow one camera's features, and add to them; says whether the image was of use.

        Cameras other than the first get its features, and own ones only where none of those are.
        """
        tracker, R_BC, R_B1B0 = self._trackers[c], self._mounts[c].R_BC, self._since[c]
        if not tracker.follow(image, None if R_B1B0 is None else R_BC.T @ R_B1B0 @ R_BC):
            return False
        self._since[c] = np.eye(3)
        if c == 0:
            tracker.begin()
            return True
        if first_sees:
            self._matchers[c - 1].match()
        if tracker.has_room:
            shared = among(tracker.ids, self._trackers[0].ids) | (not first_sees)
            tracker.begin(tracker.grid.counts(tracker.uv[shared]) == 0)
        return True


def _joined(parts: list[tuple[int, Tracks, Floats]], faults: tuple[str, ...], blind: tuple[int, ...]) -> Observations:
    """The observations of all cameras, (index, tracks, bearings) each."""
    empty = np.zeros(0, dtype=np.int64)
    return Observations(
        np.concatenate([empty, *(tracks.ids for _, tracks, _ in parts)]),
        np.concatenate([empty, *(np.full(len(tracks), c, dtype=np.int64) for c, tracks, _ in parts)]),
        np.concatenate([np.zeros((0, 2)), *(tracks.uv for _, tracks, _ in parts)]),
        np.concatenate([np.zeros((0, 3)), *(bearings for _, _, bearings in parts)]),
        faults,
        blind,
    )

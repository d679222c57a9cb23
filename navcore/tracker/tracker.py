"""Features of one camera, followed from image to image."""

import cv2
import numpy as np

from navcore.arrays import Image, Mask, Pixels, Rotations, Stamps, Vectors
from navcore.camera import Camera
from navcore.sequence import Tracks
from navcore.tracker.config import TrackerConfig
from navcore.tracker.corners import Grid, find_corners
from navcore.tracker.epipolar import two_point_inliers
from navcore.tracker.exposure import Exposed, brightness_change
from navcore.tracker.flow import flow, flow_in_other_light
from navcore.tracker.quality import ImageQuality

_MANY = 20  # features lost at once, and a third of all


class Numbers:
    """Feature numbers, never given twice."""

    def __init__(self) -> None:
        self._next = 0

    def take(self, n: int) -> Stamps:
        """(n,) new ones."""
        self._next += n
        return np.arange(self._next - n, self._next, dtype=np.int64)


class Tracker:
    """Follows features of one camera from image to image. Deterministic: the same images give the same tracks.

    Args:
        camera: whose images they are.
        config: settings.
        numbers: where features get their numbers from; trackers that share them number each feature differently.

    Attributes:
        quality: of the newest image.
        ids, uv, bearings: (N,), (N, 2) px and (N, 3) unit vectors in C of the features that the newest image holds.
    """

    def __init__(self, camera: Camera, config: TrackerConfig | None = None, numbers: Numbers | None = None) -> None:
        self.camera = camera
        self.config = config or TrackerConfig()
        self.grid = Grid(camera.width, camera.height, self.config)
        self.quality = ImageQuality(0.0, 0.0, 0.0)
        self.newest: Exposed | None = None
        self._numbers = numbers or Numbers()
        self._pairs = np.random.default_rng(0).random((self.config.hypotheses, 2))
        self._skipped = 0
        self.ids: Stamps = np.zeros(0, dtype=np.int64)
        self.uv: Pixels = np.zeros((0, 2))
        self.bearings: Vectors = np.zeros((0, 3))
        self._parallax: Pixels = np.zeros((0, 2))  # px by which each moved last, beyond what the rotation explains

    def track(self, image: Image, R_C1C0: Rotations | None) -> Tracks:
        """Follow the features of the last image into this one, and begin new ones where there is room.

        Args:
            image: (height, width) uint8.
            R_C1C0: rotation that takes bearings of the last useful image's camera frame into this one's, from a gyro
                whose bias is known; or None, and outliers are found without it.

        Returns:
            Every feature that this image holds, new ones included; `bearings` holds their directions. An image that
            offers nothing holds none; those of the last one are looked for in the next, unless it comes too late.
        """
        if self.follow(image, R_C1C0):
            self.begin()
        return self.tracks

    @property
    def tracks(self) -> Tracks:
        """Every feature that the newest image holds."""
        if self._skipped:
            return Tracks(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
        return Tracks(self.ids, self.uv)

    def follow(self, image: Image, R_C1C0: Rotations | None) -> bool:
        """The first half of `track`; says whether the image was of use."""
        self.quality = ImageQuality.of(image)
        if self.quality.useless:
            self.skip()
            return False
        now = Exposed.of(image, self.quality, self.config)
        if self.newest is not None and len(self.ids):
            self._follow(self.newest, now, R_C1C0)
        self.newest = now
        self._skipped = 0
        return True

    @property
    def has_room(self) -> bool:
        """Whether so many features are missing that new ones are looked for."""
        return self.config.max_features - len(self.ids) >= self.config.refill

    def begin(self, cells: Mask | None = None) -> None:
        """The second half of `track`: new features where there is room, in some cells or all."""
        assert self.newest is not None
        if not self.has_room:
            return
        room = self.config.max_features - len(self.ids)
        wanted = np.maximum(self.grid.share - self.grid.counts(self.uv), 0)
        if cells is not None:
            wanted[~cells] = 0
        if wanted.sum() < self.config.refill:
            return
        uv = find_corners(self.newest, self.uv, wanted, room, self.grid, self.config)
        self.add(self._numbers.take(len(uv)), uv, self.camera.unproject(uv))

    def add(self, ids: Stamps, uv: Pixels, bearings: Vectors) -> None:
        """Features (N,) that were found in the newest image at (N, 2) px, along (N, 3)."""
        self.ids = np.concatenate([self.ids, ids])
        self.uv = np.concatenate([self.uv, uv])
        self.bearings = np.concatenate([self.bearings, bearings])
        self._parallax = np.concatenate([self._parallax, np.full((len(uv), 2), np.nan)])

    def keep(self, mask: Mask) -> None:
        """End all features but those of the mask (N,)."""
        self.ids, self.uv, self.bearings = self.ids[mask], self.uv[mask], self.bearings[mask]
        self._parallax = self._parallax[mask]

    def skip(self) -> None:
        """There is no image of use at this frame. Features are looked for in the next; after too many they end."""
        self._skipped += 1
        if self._skipped > self.config.max_skipped:
            self.reset()

    def reset(self) -> None:
        """Forget the last image: all features end."""
        self.newest = None
        self.keep(np.zeros(len(self.ids), dtype=bool))

    def _follow(self, before: Exposed, now: Exposed, R_C1C0: Rotations | None) -> None:
        turned = self._turned(R_C1C0)
        start = turned + self._expected_parallax()
        start = np.where(self.camera.inside(start, 0.0)[:, None], start, self.uv)
        change = brightness_change(before, self.uv, now, start)
        changed = abs(change) > self.config.brightness_change
        uv, good = flow(before, now, self.uv, start, self.config, changed=changed)
        lost = ~good
        if lost.sum() > max(_MANY, len(lost) // 3):
            uv[lost], good[lost] = flow_in_other_light(before, now, self.uv[lost], start[lost], self.config)
        self._parallax = uv - turned
        bearings = self.bearings[good]
        self.uv = uv
        self.keep(good)
        self.bearings = self.camera.unproject(self.uv)
        if len(self.ids) >= 8:
            self.keep(self._consistent(bearings, R_C1C0))

    def _turned(self, R_C1C0: Rotations | None) -> Pixels:
        """(N, 2) where the rotation alone takes the features."""
        if R_C1C0 is None:
            return self.uv
        turned = self.camera.project(self.bearings @ R_C1C0.T)
        return np.where(self.camera.inside(turned, 0.0)[:, None], turned, self.uv)

    def _expected_parallax(self) -> Pixels:
        """(N, 2) px, what each moved last; for new ones the median of the others."""
        known = np.isfinite(self._parallax[:, 0])
        if known.all():
            return self._parallax
        usual = np.median(self._parallax[known], axis=0) if known.any() else np.zeros(2)
        return np.where(known[:, None], self._parallax, usual)

    def _consistent(self, before: Vectors, R_C1C0: Rotations | None) -> Mask:
        """Which features move as one rigid scene does."""
        threshold = self.config.epipolar_threshold / self.camera.focal
        if R_C1C0 is not None:
            return two_point_inliers(before @ R_C1C0.T, self.bearings, threshold, self._pairs)
        forward = (before[:, 2] > 0.1) & (self.bearings[:, 2] > 0.1)
        if forward.sum() < 8:
            return forward
        first, second = before[forward], self.bearings[forward]
        f = self.camera.focal
        _, inlier = cv2.findFundamentalMat(
            first[:, :2] / first[:, 2:] * f, second[:, :2] / second[:, 2:] * f, cv2.FM_RANSAC, 1.0, 0.99
        )
        keep = np.array(forward)
        if inlier is not None:
            keep[forward] = inlier.ravel() == 1
        return keep

"""Images become feature tracks: CLAHE, FAST on a grid, pyramidal KLT led by the gyro, epipolar outlier rejection."""

from dataclasses import dataclass

import cv2
import numpy as np

from navcore import so3
from navcore.arrays import Floats, Image, Mask, Pixels, Rotations, Vectors
from navcore.camera import Camera
from navcore.sequence import Tracks


@dataclass(frozen=True)
class TrackerConfig:
    """Settings of the tracker."""

    max_features: int = 150  # per image
    grid: tuple[int, int] = (8, 5)  # cells across and down, each gets its share of features
    min_distance: int = 15  # px between features when one is added
    fast_threshold: int = 15  # grey values
    clahe_clip: float = 3.0  # contrast limit of the histogram equalisation
    window: int = 15  # px, side of the KLT patch
    levels: int = 4  # pyramid levels above the image
    max_residual: float = 25.0  # mean absolute grey difference of a patch to its last one
    border: int = 8  # px, features closer to the edge end
    epipolar_threshold: float = 1.5  # px
    hypotheses: int = 40  # of the two-point RANSAC


@dataclass(frozen=True)
class ImageQuality:
    """What an image can offer, before it is tracked.

    Attributes:
        mean: grey value 0..255.
        contrast: standard deviation of grey values.
        saturated: share of pixels at the upper end.
    """

    mean: float
    contrast: float
    saturated: float

    @property
    def fault(self) -> str | None:
        """What is wrong with the image, in a word or two, or None."""
        if self.mean < 12.0 and self.contrast < 6.0:
            return "image dark"
        if self.saturated > 0.6:
            return "image saturated"
        if self.contrast < 4.0:
            return "image without texture"
        return None


class Tracker:
    """Follows features of one camera from image to image. Deterministic: the same images give the same tracks."""

    def __init__(self, camera: Camera, config: TrackerConfig | None = None) -> None:
        self.camera = camera
        self.config = config or TrackerConfig()
        self.quality = ImageQuality(0.0, 0.0, 0.0)
        self._clahe = cv2.createCLAHE(self.config.clahe_clip, (8, 8))
        self._fast = cv2.FastFeatureDetector_create(self.config.fast_threshold)
        self._pairs = np.random.default_rng(0).random((self.config.hypotheses, 2))
        self._last: Image | None = None
        self._ids = np.zeros(0, dtype=np.int64)
        self._uv: Pixels = np.zeros((0, 2))
        self.bearings: Vectors = np.zeros((0, 3))  # unit vectors in C of the newest tracks
        self._next_id = 0

    def track(self, image: Image, R_C1C0: Rotations | None) -> Tracks:
        """Follow the features of the last image into this one, and begin new ones where there is room.

        Args:
            image: (height, width) uint8.
            R_C1C0: rotation that takes bearings of the last image's camera frame into this one's, from a gyro whose
                bias is known; or None, and outliers are found without it.

        Returns:
            Every feature that this image holds, new ones included; `bearings` holds their directions. An image that
            offers nothing ends all features.
        """
        sample = image[::4, ::4]
        self.quality = ImageQuality(float(sample.mean()), float(sample.std()), float((sample >= 250).mean()))
        if self.quality.fault is not None:
            self.reset()
            return Tracks(self._ids, self._uv)
        equalised = np.asarray(self._clahe.apply(image), dtype=np.uint8)
        if self._last is not None and len(self._ids):
            self._follow(self._last, equalised, R_C1C0)
        self._begin(equalised)
        self._last = equalised
        return Tracks(self._ids, self._uv)

    def reset(self) -> None:
        """Forget the last image: all features end."""
        self._last = None
        self._keep(np.zeros(len(self._ids), dtype=bool))

    def _keep(self, mask: Mask) -> None:
        self._ids, self._uv, self.bearings = self._ids[mask], self._uv[mask], self.bearings[mask]

    def _follow(self, last: Image, image: Image, R_C1C0: Rotations | None) -> None:
        c = self.config
        start = self._uv
        if R_C1C0 is not None:
            rotated = self.bearings @ R_C1C0.T
            guess = self.camera.project(rotated)
            start = np.where(self.camera.inside(guess, 0.0)[:, None], guess, self._uv)
        found, status, error = cv2.calcOpticalFlowPyrLK(
            last,
            image,
            self._uv.astype(np.float32),
            start.astype(np.float32),
            winSize=(c.window, c.window),
            maxLevel=c.levels,
            criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 20, 0.01),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        uv = np.asarray(found, dtype=np.float64)
        good = (status.ravel() == 1) & (error.ravel() < c.max_residual) & self.camera.inside(uv, c.border)
        before = self.bearings[good]
        self._uv = uv
        self._keep(good)
        self.bearings = self.camera.unproject(self._uv)
        if len(self._ids) >= 8:
            self._keep(self._consistent(before, R_C1C0))

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

    def _begin(self, image: Image) -> None:
        """Add the strongest corners of every grid cell that has fewer features than its share."""
        c = self.config
        missing = c.max_features - len(self._ids)
        columns, rows = c.grid
        share = -(-c.max_features // (columns * rows))
        if missing < share:
            return
        h, w = image.shape
        cell = np.array([w / columns, h / rows])
        where = np.minimum((self._uv / cell).astype(int), [columns - 1, rows - 1])
        counts = np.bincount(where[:, 1] * columns + where[:, 0], minlength=columns * rows)
        fresh: list[Pixels] = []
        taken = self._uv
        for k in np.argsort(counts, kind="stable").tolist():
            wanted = min(share - int(counts[k]), c.max_features - len(taken))
            if wanted <= 0:
                break
            found = self._corners(image, taken, k % columns, k // columns, wanted)
            taken = np.concatenate([taken, found])
            fresh.append(found)
        uv = np.concatenate([np.zeros((0, 2)), *fresh])
        if len(uv) == 0:
            return
        ids = np.arange(self._next_id, self._next_id + len(uv))
        self._next_id += len(uv)
        self._ids = np.concatenate([self._ids, ids])
        self._uv = np.concatenate([self._uv, uv])
        self.bearings = np.concatenate([self.bearings, self.camera.unproject(uv)])

    def _corners(self, image: Image, taken: Pixels, column: int, row: int, wanted: int) -> Pixels:
        """Up to `wanted` corners (N, 2) in one cell, the strongest first, apart from `taken` (M, 2) and each other."""
        c = self.config
        h, w = image.shape
        u0, u1 = w * column // c.grid[0], w * (column + 1) // c.grid[0]
        v0, v1 = h * row // c.grid[1], h * (row + 1) // c.grid[1]
        u0, v0 = max(u0, c.border + 1), max(v0, c.border + 1)
        u1, v1 = min(u1, w - c.border - 1), min(v1, h - c.border - 1)
        points = self._fast.detect(image[v0:v1, u0:u1])
        if not points:
            return np.zeros((0, 2))
        response = np.array([p.response for p in points])
        strongest = np.argsort(-response, kind="stable")[: 20 * wanted]
        uv = np.array([points[k].pt for k in strongest.tolist()]) + np.array([u0, v0])
        far = np.ones(len(uv), dtype=bool)
        if len(taken):
            far = ((uv[:, None] - taken) ** 2).sum(axis=2).min(axis=1) > c.min_distance**2
        found: list[int] = []
        for k in np.flatnonzero(far).tolist():
            if all(((uv[k] - uv[j]) ** 2).sum() > c.min_distance**2 for j in found):
                found.append(k)
                if len(found) == wanted:
                    break
        return np.asarray(uv[found], dtype=np.float64).reshape(-1, 2)


def two_point_inliers(rotated: Vectors, bearings: Vectors, threshold: float, pairs: Floats) -> Mask:
    """Features that fit one translation between two views whose rotation is known (two-point RANSAC).

    Args:
        rotated: (N, 3) unit bearings of the first view, turned into the second's frame.
        bearings: (N, 3) unit bearings of the second view.
        threshold: rad, distance of a bearing from its epipolar plane.
        pairs: (M, 2) numbers in [0, 1): the random choices.

    Returns:
        (N,) mask. A feature that hardly moved fits any translation.
    """
    n = len(bearings)
    normals = so3.cross(rotated, bearings)  # |normal| is the parallax angle
    moved = np.linalg.norm(normals, axis=1)
    static = moved < threshold
    candidates = np.flatnonzero(~static)
    if len(candidates) < 3 or static.sum() > 0.9 * n:
        return np.asarray(static if static.sum() > 0.9 * n else np.ones(n, dtype=bool))
    picks = candidates[(pairs * len(candidates)).astype(int)]
    t = so3.cross(normals[picks[:, 0]], normals[picks[:, 1]])
    length = np.linalg.norm(t, axis=1)
    t = t[length > 1e-12] / length[length > 1e-12][:, None]
    if len(t) == 0:
        return np.ones(n, dtype=bool)
    best = int(np.argmax((_plane_distance(t, rotated, normals) < threshold).sum(axis=1)))
    inlier = _plane_distance(t[best : best + 1], rotated, normals)[0] < threshold
    if inlier.sum() >= 3:  # refine the translation over its inliers and judge again
        _, _, Vt = np.linalg.svd(normals[inlier], full_matrices=False)
        refined = _plane_distance(Vt[-1:], rotated, normals)[0] < threshold
        if refined.sum() >= inlier.sum():
            inlier = refined
    return np.asarray(inlier | static)


def _plane_distance(t: Vectors, rotated: Vectors, normals: Vectors) -> Floats:
    """(M, N) angle between each bearing and the plane through its first bearing and each translation (M, 3)."""
    volume = np.abs(t @ normals.T)
    cosine = t @ rotated.T
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 1e-12))
    return np.asarray(volume / sine)

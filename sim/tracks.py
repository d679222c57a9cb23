"""Features as a tracker would report them: followed while visible, lost by chance, replaced evenly."""

from dataclasses import dataclass

import numpy as np

from navcore.arrays import Stamps
from navcore.sequence import Frame, Tracks
from sim.errors import ConfigError
from sim.schedule import Schedule
from sim.view import GRID, View

_BORDER = 4.0  # px

# By severity 0..5: factors on the number of features, on their life, on the pixel noise. They are what KLT
# does on rendered images of these severities, measured against the true flow, relative to clean ones.
_LOW_LIGHT = (
    (1.0, 1.0, 1.0),
    (1.0, 0.9, 1.8),
    (0.95, 0.2, 3.5),
    (0.75, 0.055, 5.0),
    (0.5, 0.022, 6.0),
    (0.2, 0.01, 7.0),
)
_MOTION_BLUR = (
    (1.0, 1.0, 1.0),
    (1.0, 1.0, 1.1),
    (0.98, 1.0, 1.2),
    (0.97, 1.0, 1.5),
    (0.94, 1.0, 1.9),
    (0.9, 1.0, 2.2),
)


@dataclass(frozen=True)
class Seeing:
    """How well features are seen."""

    pixel_noise: float = 1.0  # px, sd per axis
    max_features: int = 150  # in one image
    track_life_s: float = 3.0  # mean time until a visible feature is lost by chance

    def __post_init__(self) -> None:
        if self.pixel_noise < 0.0 or self.track_life_s <= 0.0 or self.max_features < 1:
            raise ConfigError(f"noise must not be negative, life and features must be above zero: {self}")

    def degraded(self, schedule: Schedule, t_s: float) -> "Seeing | None":
        """How it is at a time from the first frame; None in a blackout."""
        if schedule.severity("blackout", t_s):
            return None
        dark, blur = (
            _LOW_LIGHT[schedule.severity("low_light", t_s)],
            _MOTION_BLUR[schedule.severity("motion_blur", t_s)],
        )
        features, life, noise = (a * b for a, b in zip(dark, blur, strict=True))
        return Seeing(self.pixel_noise * noise, max(1, round(self.max_features * features)), self.track_life_s * life)


def follow(view: View, seeing: Seeing, schedule: Schedule, rng: np.random.Generator) -> list[Frame]:
    """The frames, with the tracks of every camera; a landmark that is lost and found again gets a new id."""
    cameras = range(len(view.calibration.cameras))
    period_s = 1.0 / view.calibration.cameras[0].rate_hz
    active, ids, next_id = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), 0
    frames = []
    t_ns = view.poses.t_ns
    for k, (may_be_seen, candidates, cells) in enumerate(view.candidates()):
        now = seeing.degraded(schedule, (int(t_ns[k]) - int(t_ns[0])) * 1e-9)
        if now is None:
            active, ids = active[:0], ids[:0]
            frames.append(Frame(int(t_ns[k]), tracks={c: Tracks(ids, np.zeros((0, 2))) for c in cameras}))
            continue
        kept = rng.random(len(active)) < np.exp(-period_s / now.track_life_s)
        kept &= may_be_seen[active]
        active, ids = active[kept], ids[kept]
        new = _chosen(candidates, cells, active, now.max_features - len(active), rng)
        active = np.concatenate([active, new])
        ids = np.concatenate([ids, next_id + np.arange(len(new))])
        next_id += len(new)
        tracks = {}
        for c in cameras:
            uv, seen = view.pixels(k, c, active)
            seen &= view.calibration.cameras[c].camera.inside(uv, _BORDER)
            noisy = uv + now.pixel_noise * rng.standard_normal(uv.shape)
            tracks[c] = Tracks(ids[seen], noisy[seen])
            if c == 0:
                active, ids = active[seen], ids[seen]
        frames.append(Frame(int(t_ns[k]), tracks=tracks))
    return frames


def _chosen(candidates: Stamps, cells: Stamps, active: Stamps, n: int, rng: np.random.Generator) -> Stamps:
    """Up to `n` candidates that are not active, from the cells of the image that hold the fewest features."""
    if n <= 0:
        return candidates[:0]
    is_active = np.isin(candidates, active, assume_unique=True, kind="table")
    load = np.bincount(cells[is_active], minlength=GRID[0] * GRID[1])
    free = rng.permutation(np.flatnonzero(~is_active))
    order = free[np.argsort(cells[free], kind="stable")]
    sorted_cells = cells[order]
    rank = np.arange(len(order)) - np.searchsorted(sorted_cells, sorted_cells)
    best = np.argsort(load[sorted_cells] + rank, kind="stable")[:n]
    chosen: Stamps = candidates[order[best]]
    return chosen

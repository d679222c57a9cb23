"""Frames that do not come, or come with wrong stamps: for images and for tracks alike."""

from collections.abc import Sequence as ListLike
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np

from navcore.arrays import Mask, Stamps
from navcore.sequence import Frame
from sim.degrade.schedule import Schedule


@dataclass(frozen=True)
class Drops:
    """One severity of frame_drops.

    Attributes:
        share: of the frames that are lost.
        burst: mean number of frames lost in a row.
    """

    share: float
    burst: float


FRAME_DROPS = (Drops(0.1, 1.2), Drops(0.25, 2.0), Drops(0.4, 3.0), Drops(0.6, 5.0), Drops(0.8, 10.0))
LOW_RATE = (2, 3, 4, 6, 10)
"""One frame of so many is left."""
TIME_JITTER_S = (0.001, 0.002, 0.004, 0.008, 0.016)
"""Standard deviation of a stamp; no stamp moves further than `_REACH` of the way to its neighbour."""
TIME_OFFSET_S = (0.002, 0.005, 0.010, 0.020, 0.040)
"""So much later than the truth are the stamps."""
_REACH = 0.45
_LEAST_GAP_NS = 1_000_000


def restream(frames: ListLike[Frame], schedule: Schedule, seed: int = 1) -> tuple[Frame, ...]:
    """The frames that arrive, with the stamps that they arrive with; stamps increase strictly.

    Args:
        frames: in time order, with images or tracks.
        schedule: times count from the first frame; other kinds are ignored.
        seed: a frame's draw depends on it and on the frame's place alone.
    """
    if not frames:
        return ()
    t_ns = np.array([f.t_ns for f in frames], dtype=np.int64)
    stamps = _stamps(t_ns, schedule, seed)
    arrives = _arrives(t_ns, schedule, seed)
    return tuple(
        frame if stamp == frame.t_ns else replace(frame, t_ns=stamp)
        for frame, stamp, here in zip(frames, stamps.tolist(), arrives.tolist(), strict=True)
        if here
    )


def _severities(t_ns: Stamps, schedule: Schedule, kind: str) -> Stamps:
    """(N,) severity of a kind at every frame, 0 where it is off."""
    if not schedule.only([kind]).degradations:
        return np.zeros(len(t_ns), dtype=np.int64)
    return np.array([schedule.severity(kind, (t - int(t_ns[0])) * 1e-9) for t in t_ns.tolist()], dtype=np.int64)


def _stamps(t_ns: Stamps, schedule: Schedule, seed: int) -> Stamps:
    jitter = np.array([0.0, *TIME_JITTER_S])[_severities(t_ns, schedule, "time_jitter")]
    offset = np.array([0.0, *TIME_OFFSET_S])[_severities(t_ns, schedule, "time_offset")]
    rng = _generator(seed, "time_jitter")
    gap = np.diff(t_ns)
    least = np.minimum(np.append(gap, gap[-1:]), np.insert(gap, 0, gap[:1])) if len(gap) else np.zeros(1)
    moved = np.clip(jitter * 1e9 * rng.standard_normal(len(t_ns)), -_REACH * least, _REACH * least)
    stamps: Stamps = t_ns + np.rint(moved + offset * 1e9).astype(np.int64)
    for k in np.flatnonzero(jitter + offset > 0.0)[::-1].tolist():  # a late one stays before the frame after it
        if k + 1 < len(stamps):
            stamps[k] = min(stamps[k], stamps[k + 1] - _LEAST_GAP_NS)
    return stamps


def _arrives(t_ns: Stamps, schedule: Schedule, seed: int) -> Mask:
    """(N,): losses are a two-state chain (Gilbert, "Capacity of a burst-noise channel", 1960)."""
    drops = _severities(t_ns, schedule, "frame_drops")
    rates = _severities(t_ns, schedule, "low_rate")
    arrives = np.ones(len(t_ns), dtype=bool)
    draws = _generator(seed, "frame_drops").random(len(t_ns))
    lost = False
    since = 0
    for k in range(len(t_ns)):
        if drops[k]:
            chain = FRAME_DROPS[drops[k] - 1]
            into = chain.share / (chain.burst * (1.0 - chain.share))
            lost = bool(draws[k] > 1.0 / chain.burst) if lost else bool(draws[k] < into)
        else:
            lost = False
        since = since + 1 if rates[k] else 0
        left = rates[k] == 0 or (since - 1) % LOW_RATE[rates[k] - 1] == 0
        arrives[k] = left and not lost
    return arrives


def _generator(seed: int, what: str) -> np.random.Generator:
    return np.random.default_rng((seed, crc32(what.encode())))

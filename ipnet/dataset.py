"""Windows of recordings, as a network sees them in training."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from ipnet.errors import LabelError
from ipnet.presets import NetworkConfig
from ipnet.recordings import Recording, find_all, open_recordings
from ipnet.windows import MAX_GAP_S, means
from navcore import so3
from navcore.arrays import Floats, Rotations, Stamps
from navcore.imu import ImuSamples


@dataclass(frozen=True)
class Track:
    """What training needs of a recording.

    Attributes:
        name: of the recording.
        imu: its samples.
        bias: (N, 6) b_g, b_a at each of them.
        velocity: (N, 3) m/s in B at each of them; nan where truth has none.
    """

    name: str
    imu: ImuSamples
    bias: Floats
    velocity: Floats

    def window(self, begin_ns: int, config: NetworkConfig) -> tuple[Floats, Floats]:
        """Means (n, 6) from that time on, and the bias (6,) in their middle."""
        edges = begin_ns + np.rint(np.arange(config.samples + 1) * 1e9 / config.rate_hz).astype(np.int64)
        part = self._around(edges)
        middle = int(np.searchsorted(self.imu.t_ns, edges[config.samples // 2]))
        return means(part, edges), self.bias[min(middle, len(self.bias) - 1)]

    def motion(self, begin_ns: int, config: NetworkConfig) -> Floats:
        """(n, 9) means of rate and specific force, free of biases, and velocities in B in the middles of samples."""
        edges = begin_ns + np.rint(np.arange(config.samples + 1) * 1e9 / config.rate_hz).astype(np.int64)
        _, bias = self.window(begin_ns, config)
        middle = np.searchsorted(self.imu.t_ns, edges[:-1] + np.diff(edges) // 2)
        return np.hstack([means(self._around(edges), edges) - bias, self.velocity[middle]])

    def _around(self, edges: Stamps) -> ImuSamples:
        """The samples that matter between the first and the last edge."""
        first, last = np.searchsorted(self.imu.t_ns, edges[[0, -1]])
        return self.imu[max(int(first) - 2, 0) : int(last) + 2]

    def begins(self, config: NetworkConfig) -> list[tuple[int, int]]:
        """Spans [ns] in which a window may begin: it fits, and no gap lies in it."""
        t = self.imu.t_ns
        cuts = np.flatnonzero(np.diff(t) > MAX_GAP_S * 1e9) + 1
        length = round(config.samples / config.rate_hz * 1e9)
        parts = zip([0, *cuts], [*cuts, len(t)], strict=True)
        spans = [(int(t[a]), int(t[b - 1]) - length) for a, b in parts]
        return [(a, b) for a, b in spans if b > a]


def open_tracks(
    paths: Iterable[Path], labels: Path | None, cache: Path, names: Iterable[str] | None = None
) -> list[Track]:
    """Recordings in folders, in order; what was read once is kept in `cache`.

    Args:
        paths: folders.
        labels: for recordings whose truth has no biases.
        cache: folder.
        names: of those to take; None for all.

    Raises:
        LabelError: see `open_recordings`.
    """
    return [_track(folder, labels, cache) for folder in find_all(paths, names)]


def _track(folder: Path, labels: Path | None, cache: Path) -> Track:
    known = labels.read_bytes() if labels is not None else b""
    table = next(folder.rglob("imu0/data.csv"))
    state = table.stat()
    key = hashlib.sha256(f"{table.resolve()} {state.st_size} {state.st_mtime_ns}".encode() + known).hexdigest()[:16]
    kept = cache / f"{folder.name}-{key}.npz"
    if not kept.is_file():
        (recording,) = open_recordings([folder], labels)
        imu, bias = recording.imu, recording.bias_at(recording.imu.t_ns)
        cache.mkdir(parents=True, exist_ok=True)
        partial = kept.with_suffix(".partial")
        with partial.open("wb") as file:
            np.savez(file, t_ns=imu.t_ns, gyro=imu.gyro, accel=imu.accel, bias=bias, velocity=_velocity(recording))
        partial.replace(kept)
    with np.load(kept) as read:
        imu = ImuSamples(read["t_ns"], read["gyro"], read["accel"])
        return Track(folder.name, imu, read["bias"], read["velocity"])


def _velocity(recording: Recording) -> Floats:
    """(N, 3) in B at the IMU's stamps, from differences of positions where truth has none; nan outside it."""
    truth, t_ns = recording.truth, recording.imu.t_ns
    v_B = np.full((len(t_ns), 3), np.nan)
    if truth is None:
        return v_B
    if truth.v_WB is None:
        truth = replace(truth, v_WB=np.gradient(truth.p_WB, truth.seconds, axis=0))  # noisy; blocks are means of it
    inside = truth.covers(t_ns)
    there = truth.at(t_ns[inside])
    assert there.v_WB is not None
    v_B[inside] = np.einsum("nji,nj->ni", so3.from_quaternion(there.q_WB), there.v_WB)
    return v_B


@dataclass(frozen=True)
class Windows(Dataset[tuple[Tensor, Tensor]]):
    """Windows and their labels: (n, 6) and (6,) float32.

    Attributes:
        config: of the network.
        tracks: recordings.
        places: recording, begin [ns], and rotation (3, 3) of the mount of each window.
    """

    config: NetworkConfig
    tracks: list[Track]
    places: list[tuple[int, int, Rotations]]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, k: int) -> tuple[Tensor, Tensor]:
        track, begin_ns, R = self.places[k]
        values, bias = self.tracks[track].window(begin_ns, self.config)
        turned = values.reshape(-1, 2, 3) @ R.T
        return (
            torch.from_numpy(turned.reshape(-1, 6).astype(np.float32)),
            torch.from_numpy((bias.reshape(2, 3) @ R.T).reshape(6).astype(np.float32)),
        )

    def motion(self, k: int) -> Floats:
        """(n, 9) rate, specific force and velocity of a window, in the network's frame where that is turned already."""
        track, begin_ns, R = self.places[k]
        motion = self.tracks[track].motion(begin_ns, self.config)
        return (motion.reshape(-1, 3, 3) @ R.T).reshape(-1, 9)


def random_windows(
    tracks: list[Track], config: NetworkConfig, each: int, mount_deg: float, rng: np.random.Generator
) -> Windows:
    """`each` windows of every recording that is long enough, with random beginnings and mounts.

    Args:
        mount_deg: sd of the mount's rotation about each axis; from 180 on any rotation is as likely.

    Raises:
        LabelError: no recording is long enough.
    """
    places = []
    for k, spans in _usable(tracks, config):
        lengths = np.array([b - a for a, b in spans], dtype=np.float64)
        for part, share in zip(rng.choice(len(spans), each, p=lengths / lengths.sum()), rng.random(each), strict=True):
            a, b = spans[part]
            places.append((k, a + int(share * (b - a)), _mount(mount_deg, rng)))
    return Windows(config, tracks, places)


def regular_windows(tracks: list[Track], config: NetworkConfig, every_s: float) -> Windows:
    """Windows of every recording that is long enough, as they are.

    Raises:
        LabelError: no recording is long enough.
    """
    every_ns = round(every_s * 1e9)
    usable = _usable(tracks, config)
    places = [(k, t, np.eye(3)) for k, spans in usable for a, b in spans for t in range(a, b, every_ns)]
    return Windows(config, tracks, places)


def _usable(tracks: list[Track], config: NetworkConfig) -> list[tuple[int, list[tuple[int, int]]]]:
    usable = [(k, spans) for k, track in enumerate(tracks) if (spans := track.begins(config))]
    if not usable:
        seconds = config.samples / config.rate_hz
        raise LabelError(f"none of {len(tracks)} recordings is longer than a window of {seconds:.3g} s")
    return usable


def _mount(mount_deg: float, rng: np.random.Generator) -> Rotations:
    if mount_deg < 180.0:
        return so3.exp(np.deg2rad(mount_deg) * rng.standard_normal(3))
    q = rng.standard_normal(4)
    return so3.from_quaternion(q / np.linalg.norm(q))

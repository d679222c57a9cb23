"""What each kind and severity does to feature tracks, measured with the tracker: the scale of severities."""

from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from navcore.arrays import Image, Pixels, Stamps
from navcore.calibration import CameraMount
from navcore.readers import open_sequence
from navcore.sequence import Frame, ImageArray, Sequence, Tracks
from navcore.tracker import Tracker
from sim.camera.film import Film
from sim.degrade import Schedule, degrade_sequence
from sim.degrade.apply import gyro_bias
from sim.degrade.attitude import Attitude
from sim.degrade.schedule import GRADED, MAX_SEVERITY, RENDERED, STREAM
from sim.errors import ConfigError
from sim.imu import grade, simulate_imu
from sim.motion import Motion
from sim.platforms import simulate_motion
from sim.points import IMU_GRADE, frame_stamps
from sim.rig import euroc_like
from sim.streams import Streams
from sim.world import Layout, make_scene

KINDS = tuple(kind for kind in GRADED if kind not in STREAM)
"""Kinds that act on tracks."""
WRONG_PX = 2.0
"""A track that goes so much elsewhere than the scene from one frame to the next is wrong."""

_LATER_S = 1.0  # after which survival is asked for
_SOON_S = 0.25  # the same, for the hazard of the worst severities
POINTS_LIFE_S = 3.0
"""Mean life of a track in points mode."""
_FLIGHT_S = 30.0
_SEEDS = {"auto_exposure": (1, 2, 3, 4), "light_switch": (1, 2, 3, 4)}
_LK = {"winSize": (15, 15), "maxLevel": 4}
_RETURN_PX = 0.3
_FEW = 20  # steps of which no figure is made

Flow = Callable[[int, Pixels], Pixels]
"""Where points (N, 2) px of a frame are truly seen in the next one; NaN where that is not known."""


@dataclass(frozen=True)
class Tracking:
    """How a tracker fared over a clip.

    A step of a track from one frame to the next is wrong if it ends further than `WRONG_PX` from where the scene went;
    where the flow is not known, it is not.

    Attributes:
        features: mean number in a frame.
        lasting: mean number that are followed for a second, right in their first and in their last step.
        soon: share of the tracks with a right first step that are right a quarter of a second later.
        noise: px rms per axis of the steps that are not wrong; NaN if there are too few.
        wrong: share of steps that are wrong; NaN if there are too few.
    """

    features: float
    lasting: float
    soon: float
    noise: float
    wrong: float


@dataclass(frozen=True)
class Clip:
    """A stretch of a recording in memory, and the flow in it."""

    sequence: Sequence
    flow: Flow
    exposed: Callable[[int], Sequence] | None
    """The clip rendered with motion_blur of a severity; None where that is done to the images."""

    def degraded(self, kind: str, severity: int, seed: int) -> Sequence:
        """The clip under one kind all the time."""
        if severity == 0:
            return self.sequence
        if kind in RENDERED and self.exposed is not None:
            return self.exposed(severity)
        length_s = (self.sequence.frames[-1].t_ns - self.sequence.frames[0].t_ns) * 1e-9
        return degrade_sequence(self.sequence, Schedule.parse(f"{kind}:{severity}@0-{length_s + 0.5:.3f}"), seed)


def measure(clip: Clip, kind: str, severity: int) -> Tracking:
    """How a tracker fares in a degraded clip; where events are rare, the mean over several draws of them."""
    draws = [_tracked(clip.degraded(kind, severity, seed), clip.flow) for seed in _SEEDS.get(kind, (1,))]
    return Tracking(*np.mean([astuple(draw) for draw in draws], axis=0).tolist())


def _tracked(sequence: Sequence, flow: Flow) -> Tracking:
    """Track; rotation comes from the gyro, as in the filter."""
    mount = sequence.calibration.cameras[0]
    attitude = Attitude.of(sequence.imu, gyro_bias(sequence))
    stamps = np.array([f.t_ns for f in sequence.frames]) + round(mount.dt_cam_imu * 1e9)
    R_WC = attitude.at(stamps) @ mount.R_BC
    tracker = Tracker(mount.camera)
    tracks: list[Tracks] = []
    last = None  # image of use
    for k, frame in enumerate(sequence.frames):
        R_C1C0 = R_WC[k].T @ R_WC[last] if last is not None else None
        tracks.append(tracker.track(frame.images[0].load(), R_C1C0))
        last = last if tracker.quality.useless else k
    steps = [_step(k, *pair, flow) for k, pair in enumerate(pairwise(tracks))]
    rate_hz = (len(stamps) - 1) / ((stamps[-1] - stamps[0]) * 1e-9)
    begun, lasting = _kept(steps, round(_LATER_S * rate_hz))
    begun_too, soon = _kept(steps, round(_SOON_S * rate_hz))
    errors = np.concatenate([np.zeros((0, 2)), *(step.error for step in steps)])
    errors = errors[np.isfinite(errors).all(axis=1)]
    wrong = np.linalg.norm(errors, axis=1) > WRONG_PX
    return Tracking(
        float(np.mean([len(t) for t in tracks])),
        lasting / max(1, len(steps) - round(_LATER_S * rate_hz) + 1) if begun else 0.0,
        soon / begun_too if begun_too else 0.0,
        float(np.sqrt(np.mean(errors[~wrong] ** 2))) if (~wrong).sum() > _FEW else float("nan"),
        float(wrong.mean()) if len(wrong) > _FEW else float("nan"),
    )


@dataclass(frozen=True)
class _Step:
    """From one frame to the next: which features were followed (N,), their error (N, 2) px or NaN, who was right."""

    ids: Stamps
    error: Pixels

    @property
    def right(self) -> Stamps:
        """(M,) ids."""
        right: Stamps = self.ids[~(np.linalg.norm(self.error, axis=1) > WRONG_PX)]
        return right


def _step(k: int, before: Tracks, after: Tracks, flow: Flow) -> _Step:
    ids, i, j = np.intersect1d(before.ids, after.ids, assume_unique=True, return_indices=True)
    return _Step(ids, after.uv[j] - flow(k, before.uv[i]) if len(ids) else np.zeros((0, 2)))


def _kept(steps: list[_Step], frames: int) -> tuple[int, int]:
    """Number of tracks with a right step, and of those that make a right step so many frames later too."""
    pairs = list(zip(steps, steps[frames - 1 :], strict=False))
    return sum(len(a.right) for a, _ in pairs), sum(int(np.isin(a.right, b.right).sum()) for a, b in pairs)


def real_clip(path: Path, start_s: float, seconds: float) -> Clip:
    """A stretch of a recording."""
    clean = _in_memory(open_sequence(path).span(start_s, start_s + seconds))
    return Clip(clean, _CleanImages([frame.images[0].load() for frame in clean.frames]).flow, None)


def rendered_clip(start_s: float, seconds: float, seed: int = 1) -> Clip:
    """A stretch of a rendered flight of a quadrotor in a room, whose flow is known."""
    motion = simulate_motion("quadrotor", _FLIGHT_S, seed)
    device = grade(IMU_GRADE)
    calibration = euroc_like(device.noise)
    streams = Streams.of(seed)
    samples, truth = simulate_imu(motion, device, streams.imu)
    scene = make_scene("room", motion, streams.world)
    rate_hz = calibration.cameras[0].rate_hz
    stamps = frame_stamps(motion, rate_hz)[round(start_s * rate_hz) :][: round(seconds * rate_hz)]
    if len(stamps) < 2:
        raise ConfigError(f"a clip of {seconds} s from {start_s} s has no frames in a flight of {_FLIGHT_S} s")

    def filmed(severity: int) -> Sequence:
        schedule = Schedule.parse(f"motion_blur:{severity}@0-{seconds}" if severity else "")
        with Film(motion, calibration, scene, stamps, schedule, np.random.default_rng(seed)) as film:
            return _in_memory(Sequence("flight", calibration, samples, film.frames, truth))

    return Clip(filmed(0), _Scene(motion, calibration.cameras[0], scene.layout, stamps).flow, filmed)


def _in_memory(sequence: Sequence) -> Sequence:
    frames = tuple(Frame(f.t_ns, {0: ImageArray(f.images[0].load())}) for f in sequence.frames if 0 in f.images)
    return replace(sequence, frames=frames)


@dataclass(frozen=True)
class _CleanImages:
    """Knows where the clean images went."""

    images: list[Image]

    def flow(self, k: int, uv: Pixels) -> Pixels:
        """Where points of frame k are in frame k + 1: there and back again without a difference, or NaN."""
        start = uv.astype(np.float32)
        there, found, _ = cv2.calcOpticalFlowPyrLK(self.images[k], self.images[k + 1], start, None, **_LK)
        back, returned, _ = cv2.calcOpticalFlowPyrLK(self.images[k + 1], self.images[k], there, None, **_LK)
        sure = (found.ravel() == 1) & (returned.ravel() == 1) & (np.linalg.norm(back - start, axis=1) < _RETURN_PX)
        return np.where(sure[:, None], there.astype(np.float64), np.nan)


@dataclass(frozen=True)
class _Scene:
    """Knows how far everything is."""

    motion: Motion
    mount: CameraMount
    layout: Layout
    stamps: Stamps

    def flow(self, k: int, uv: Pixels) -> Pixels:
        """Where points of frame k are in frame k + 1."""
        camera = self.mount.camera
        poses = self.motion.at(self.stamps[k : k + 2])
        R_WC = poses.R_WB @ self.mount.R_BC
        p_WC = poses.p_WB + poses.R_WB @ self.mount.p_BC
        rays_W = camera.unproject(uv) @ R_WC[0].T
        start = np.tile(p_WC[0], (len(uv), 1))
        p_WF = start + self.layout.distance(start, rays_W)[:, None] * rays_W
        p_CF = (p_WF - p_WC[1]) @ R_WC[1]
        return np.where(camera.visible(p_CF)[:, None], camera.project(p_CF), np.nan)


def report(clip: Clip, title: str, progress: Callable[[int, int], None] | None = None) -> str:
    """Markdown: every kind that acts on tracks, by severity, relative to the clean clip."""
    clean = measure(clip, KINDS[0], 0)
    cells = [(kind, severity) for kind in KINDS for severity in range(1, MAX_SEVERITY + 1)]
    found: dict[tuple[str, int], Tracking] = {}
    for cell in cells:
        found[cell] = measure(clip, *cell)
        if progress is not None:
            progress(len(found), len(cells))
    shares = {kind: [found[kind, k].lasting / clean.lasting for k in range(1, MAX_SEVERITY + 1)] for kind in KINDS}
    lines = [
        f"## {title}",
        "",
        f"Clean: {clean.features:.0f} features in a frame, {clean.lasting:.0f} of which are followed for a second, with"
        f" {clean.noise:.2f} px rms of error from frame to frame.",
        "",
        "Tracks that survive, as a share of those that survive in clean images:",
        "",
        "| kind | 1 | 2 | 3 | 4 | 5 |",
        "|---|---|---|---|---|---|",
        *(f"| `{kind}` | {' | '.join(f'{share:.2f}' for share in shares[kind])} |" for kind in KINDS),
        "",
        "Features, life and noise are factors on those of clean images; wrong is the share of steps, beyond theirs:",
        "",
        "| kind | severity | features | life | noise | wrong |",
        "|---|---|---|---|---|---|",
        *(f"| `{kind}` | {k} | {_details(clean, found[kind, k])} |" for kind, k in cells),
    ]
    return "\n".join(lines) + "\n"


def _details(clean: Tracking, got: Tracking) -> str:
    tracks = f"{got.features / clean.features:.2f} | {life(clean, got):.2f}"
    noise = f"{got.noise / clean.noise:.2f}" if np.isfinite(got.noise) else "–"
    wrong = f"{max(0.0, got.wrong - clean.wrong):.2f}" if np.isfinite(got.wrong) else "–"
    return f"{tracks} | {noise} | {wrong}"


def life(clean: Tracking, got: Tracking) -> float:
    """Factor on the mean life of tracks that are lost by chance after `POINTS_LIFE_S` if vision is clean.

    What is lost sooner than in the clean clip is a hazard of its own, added to 1 / `POINTS_LIFE_S`.
    """
    share = max(got.soon, 1e-3 * clean.soon) / clean.soon
    hazard = max(0.0, -float(np.log(share)) / _SOON_S)
    return 1.0 / (1.0 + hazard * POINTS_LIFE_S)
